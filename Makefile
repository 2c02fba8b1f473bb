# make fly    makes a virtual environment, installs, and flies the first mission in the simulator
# make test   installs what the tests need as well and runs them all
# make lint   formatting, lint rules and types
# make firmware   the land controller's image for the STM32, see firmware_bridge/README.md

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Name a CPU build where the index offers none by itself; see README, "Training"
TORCH ?= torch==2.13.0

.PHONY: fly house test lint dialect firmware firmware-coverage firmware-fuzz firmware-mutants clean

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed; name one with: make fly PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	$(BIN)/python -m labr_autonomy.warm_up
	$(BIN)/python -m sim.warm_up
	@touch $@

$(VENV)/installed-test: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt $(TORCH)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[train,test]'
	@touch $@

$(VENV)/installed-lint: $(VENV)/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[lint]'
	@touch $@

fly: $(VENV)/installed
	$(BIN)/labr-mission fly missions/first_flight.yaml $(ARGS)

house: $(VENV)/installed
	$(BIN)/labr-mission fly missions/small_house.yaml $(ARGS)

test: $(VENV)/installed-test
	$(BIN)/python -m pytest $(ARGS)

lint: $(VENV)/installed-lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

firmware: $(VENV)/installed
	$(BIN)/python -m firmware_bridge.build $(ARGS)

firmware-coverage: $(VENV)/installed-test
	$(BIN)/python -m firmware_bridge.coverage

firmware-fuzz: $(VENV)/installed
	$(BIN)/python -m firmware_bridge.fuzz $(ARGS)

firmware-mutants: $(VENV)/installed-test
	$(BIN)/python -m firmware_bridge.mutants $(ARGS)

dialect: $(VENV)/installed
	$(BIN)/python -m firmware_bridge.dialect.generate

clean:
	rm -rf $(VENV) build dist *.egg-info
