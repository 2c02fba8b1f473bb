"""What the README shows is true: its mission loads, its commands exist, its picture and paths are there."""

import re
import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from labr_autonomy.cli import main
from labr_autonomy.mission.load import parse_mission, validated
from labr_autonomy.mission.source import parse
from sim.worlds.world_file import WorldFile

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_mission_and_the_world_file_of_the_readme_load():
    mission, world = re.findall(r"```yaml\n(.*?)```", README, flags=re.DOTALL)
    assert len(parse_mission(mission.encode()).items) == 5
    assert validated(parse(world.encode(), "world"), WorldFile).up == "y"


@pytest.mark.parametrize("line", re.findall(r"^(labr-mission [\w-]+ .*)$", README, flags=re.MULTILINE))
def test_every_command_line_of_the_readme_parses(line):
    command, words = main, shlex.split(line)[1:]
    while isinstance(command, click.Group):
        command = command.get_command(None, words.pop(0))
        assert command is not None
    known = {option for parameter in command.params for option in parameter.opts}
    assert {word for word in words if word.startswith("--")} <= known


@pytest.mark.parametrize("command", sorted(set(re.findall(r"`labr-mission (\w+)", README))))
def test_every_command_of_the_readme_exists(command):
    assert command in main.list_commands(None)
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
