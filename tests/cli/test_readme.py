"""What the README shows is true: its mission loads, its commands exist, its picture and paths are there."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from labr_autonomy.cli import main
from labr_autonomy.mission.load import parse_mission

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_mission_of_the_readme_loads():
    (text,) = re.findall(r"```yaml\n(.*?)```", README, flags=re.DOTALL)
    assert len(parse_mission(text.encode()).items) == 5


@pytest.mark.parametrize("command", sorted(set(re.findall(r"`labr-mission (\w+)", README))))
def test_every_command_of_the_readme_exists(command):
    assert command in main.list_commands(None)
    if command not in ("dataset", "train"):  # those two show the help of the module behind them
        assert CliRunner().invoke(main, [command, "--help"]).exit_code == 0


@pytest.mark.parametrize("target", sorted(set(re.findall(r"^make (\w+)", README, flags=re.MULTILINE))))
def test_every_make_target_of_the_readme_exists(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)


@pytest.mark.parametrize(
    "path",
    sorted(set(re.findall(r"`((?:labr_autonomy|firmware_bridge|sim|missions)[\w/]*(?:\.\w+)?)`", README))),
)
def test_every_path_of_the_readme_is_there(path):
    assert (ROOT / path).exists()


def test_the_picture_of_the_readme_is_there():
    for picture in re.findall(r"!\[[^]]*\]\(([^)]+)\)", README):
        assert (ROOT / picture).is_file()
