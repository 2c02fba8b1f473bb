"""`python -m labr_autonomy`: the same as `labr-mission`."""

from labr_autonomy.cli import main

if __name__ == "__main__":
    main()
