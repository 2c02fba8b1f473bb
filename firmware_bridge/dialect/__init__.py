"""`labr_land.xml` defines the messages; `labr_land.py` is generated from it by `generate.py`."""
