"""Small changes to `core/`, one at a time, that the tests must notice: `python -m firmware_bridge.mutants`.

Each mutant is compiled and the tests of the C core run against it until one fails; a mutant that none fails
on has survived, and stands for something that no test looks at. Those known, with the reason why they do no
harm, are in `mutants_known.txt`. Exit 4 if another one survived.
"""

from __future__ import annotations

import argparse
import importlib
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from firmware_bridge import build
from firmware_bridge.coverage import FILES
from firmware_bridge.coverage import TESTS as TESTS_FOLDER
from firmware_bridge.host.library import LIBRARY_VARIABLE
from firmware_bridge.parameters import Parameters
from labr_autonomy.clock import SystemClock, pause_s
from labr_autonomy.config import RobotConfig
from labr_autonomy.errors import BadInput, ExitCode, LabrError

KNOWN = build.HERE / "mutants_known.txt"
TESTS_S = 120.0  # a mutant whose tests take longer hangs, and is noticed by that
NO_MUTANT = 77  # exit code of a judge whose mutant is no program
RANDOM_LIFE = "test_core_agrees_with_python_in_every_step_of_a_random_life"
# Those of the C core, without the ones that build it themselves.
TESTS = [*(str(TESTS_FOLDER / name) for name in FILES)]
TESTS += ["-k", "not qemu and not twin and not bad_bytes and not 210_ms"]
TESTS += [
    word
    for seed in range(3, 12)
    for word in ("--deselect", f"tests/ground/{FILES[1]}::{RANDOM_LIFE}[{seed}]")
]

# What the tests import, so that no judge has to.
WARM = ("pytest", "hypothesis", "numpy", "cffi", "sim.land_controller", "sim.rover", "sim.firmware.qemu")

SWAPS: tuple[tuple[str, str], ...] = (
    (r" <= ", " < "),
    (r" >= ", " > "),
    (r" < ", " <= "),
    (r" > ", " >= "),
    (r" == ", " != "),
    (r" != ", " == "),
    (r" && ", " || "),
    (r" \|\| ", " && "),
    (r" \+ ", " - "),
    (r" - ", " + "),
    (r" \* ", " / "),
    (r"!(?=[a-z(])", ""),
    (r"\btrue\b", "false"),
    (r"\bfalse\b", "true"),
    (r"\+\+", "--"),
    (r" \+= ", " -= "),
    (r"\bfmaxf\b", "fminf"),
    (r"\bfminf\b", "fmaxf"),
    (r"\b0\.0f\b", "1.0f"),
    (r"\b1u?\b(?=[;,)\] ])", "2"),
)
NUMBERS = re.compile(r"(#define LAND_\w+ )([0-9.e-]+)(f?u?)\b")
STATEMENT = re.compile(r"^\s+[a-z][\w>.\-\[\]]*(\(.*\)| \|?\+?-?=.*|\+\+|--);$")


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change."""

    file: str
    line: int  # from 1
    old: str
    new: str

    @property
    def key(self) -> str:
        """What names it in `mutants_known.txt`: no line number, so that it outlives other changes."""
        return f"{self.file}: {self.old.strip()} -> {self.new.strip() or '(nothing)'}"


def mutants_of(path: Path) -> Iterator[Mutant]:
    """All changes of one file."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        code = line.split("//")[0].rstrip()
        if not code or code.startswith(("#include", "#pragma", "#if", "#endif", "#undef")):
            continue
        found = NUMBERS.match(code)
        if found:
            value = float(found[2])
            changed = (
                f"{found[1]}{value * 2 if '.' in found[2] or 'e' in found[2] else int(value) + 1}{found[3]}"
            )
            yield Mutant(path.name, number, code, changed)
            continue
        if path.suffix == ".h" or code.startswith("#"):
            continue
        for pattern, replacement in SWAPS:
            for match in re.finditer(pattern, code):
                yield Mutant(
                    path.name, number, code, code[: match.start()] + replacement + code[match.end() :]
                )
        if STATEMENT.match(code):
            yield Mutant(path.name, number, code, "")


def all_mutants() -> list[Mutant]:
    """Every change of every file of the core."""
    files = sorted([*build.CORE.glob("*.c"), *build.CORE.glob("*.h")])
    return [m for path in files for m in mutants_of(path)]


def known() -> dict[str, str]:
    """Survivors that are understood: key and reason."""
    rows = {}
    for line in KNOWN.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            key, reason = line.split("  # ")
            rows[key.strip()] = reason.strip()
    return rows


def _compile(folder: Path, *arguments: str) -> None:
    """Run gcc in `folder` as quickly as it goes: no optimisation, no warnings.

    Raises:
        BadInput: It refused.
    """
    include = build.headers(Parameters.of(RobotConfig()))
    paths = [f"-I{build.CORE}", f"-I{include}", f"-isystem{include / 'mavlink'}"]
    command = ["gcc", "-std=c11", "-w", "-O0", "-fPIC", *arguments, *paths]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BadInput(f"gcc refused the core: {done.stderr.strip()[-500:]}")


def _compile_all(scratch: Path) -> None:
    """Objects of the core as it is, for mutants that change one file only.

    Raises:
        Refused: There is no gcc.
        BadInput: It refused the core.
    """
    build.host_library()  # says so where there is no gcc
    sources = [*sorted(build.CORE.glob("*.c")), build.HOST / "land_host.c"]
    _compile(scratch, "-c", *(str(p) for p in sources))


def _mutated(mutant: Mutant, scratch: Path) -> Path:
    """The library with one change.

    Raises:
        BadInput: It does not compile.
    """
    own = scratch / f"core-{os.getpid()}"
    shutil.copytree(build.CORE, own)
    lines = (own / mutant.file).read_text(encoding="utf-8").splitlines()
    lines[mutant.line - 1] = mutant.new
    (own / mutant.file).write_text("\n".join(lines) + "\n", encoding="utf-8")
    if mutant.file.endswith(".c"):
        name = mutant.file.removesuffix(".c") + ".o"
        parts = [str(own / mutant.file), *(str(p) for p in scratch.glob("*.o") if p.name != name)]
    else:  # the copy's headers come first, for they lie beside its sources
        parts = [f"-I{own}", *(str(p) for p in own.glob("*.c")), str(build.HOST / "land_host.c")]
    _compile(own, "-shared", *parts, "-o", "libland.so", "-lm")
    return own / "libland.so"


def _judge(mutant: Mutant, scratch: Path) -> int:
    """In a process of its own: 0 if all tests pass on the mutant, NO_MUTANT if it does not compile."""
    try:
        library = _mutated(mutant, scratch)
    except BadInput:
        return NO_MUTANT
    import pytest

    os.environ[LIBRARY_VARIABLE] = str(library)
    try:
        return int(pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-W", "ignore", *TESTS]))
    finally:
        shutil.rmtree(library.parent, ignore_errors=True)


def _start(mutant: Mutant, scratch: Path) -> int:
    """Fork a judge; everything that tests import is imported already, so that it begins at once."""
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        return pid
    code = 1
    try:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        code = _judge(mutant, scratch)
    finally:
        os._exit(code)


def verdicts(chosen: Sequence[Mutant], jobs: int, scratch: Path) -> Iterator[tuple[Mutant, int]]:
    """Each mutant with its judge's exit code, in the order in which they end."""
    clock, waiting = SystemClock(), list(reversed(chosen))
    running: dict[int, tuple[Mutant, float]] = {}
    while waiting or running:
        while waiting and len(running) < jobs:
            mutant = waiting.pop()
            running[_start(mutant, scratch)] = (mutant, clock.now_s() + TESTS_S)
        for pid, (mutant, until_s) in list(running.items()):
            ended, status = os.waitpid(pid, os.WNOHANG)
            if not ended and clock.now_s() > until_s:
                os.kill(pid, signal.SIGKILL)
                ended, status = os.waitpid(pid, 0)
            if ended:
                del running[pid]
                yield mutant, os.waitstatus_to_exitcode(status)
        pause_s(0.01)


def main(argv: list[str] | None = None) -> int:
    """Entry of `python -m firmware_bridge.mutants`."""
    parser = argparse.ArgumentParser(prog="firmware_bridge.mutants", description="Mutation run of core/.")
    parser.add_argument("--sample", type=int, help="only so many, drawn by --seed")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--file", help="only this file of core/")
    arguments = parser.parse_args(argv)
    chosen = [m for m in all_mutants() if arguments.file in (None, m.file)]
    if not chosen:
        sys.stderr.write(f"{BadInput(f'there is no file {arguments.file} in core/', 'Name one of it')}\n")
        return int(ExitCode.BAD_INPUT)
    if arguments.sample is not None and arguments.sample < len(chosen):
        chosen = random.Random(arguments.seed).sample(chosen, arguments.sample)
    for module in WARM:
        importlib.import_module(module)
    understood = known()
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        try:
            _compile_all(scratch)
        except LabrError as error:
            sys.stderr.write(f"{error}\n")
            return int(error.exit_code)
        # Where the unchanged core fails, every mutant would seem noticed.
        nothing = replace(chosen[0], new=chosen[0].old)
        if [code for _, code in verdicts([nothing], 1, scratch)] != [0]:
            sys.stderr.write("the tests fail on the core as it is; mend that first\n")
            return int(ExitCode.REFUSED)
        real, survivors = _run(chosen, arguments.jobs, understood, scratch)
    unknown = [m for m in survivors if m.key not in understood]
    sys.stdout.write(
        f"{real} mutants, {real - len(survivors)} noticed, {len(survivors)} survived, "
        f"{len(unknown)} of them not understood\n"
    )
    return int(ExitCode.EXPECTATION_MISSED if unknown else ExitCode.DONE)


def _run(
    chosen: Sequence[Mutant], jobs: int, understood: dict[str, str], scratch: Path
) -> tuple[int, list[Mutant]]:
    """How many mutants there were, and which survived."""
    survivors, real = [], 0
    for done, (mutant, code) in enumerate(verdicts(chosen, jobs, scratch), start=1):
        real += code != NO_MUTANT
        if code == 0:
            survivors.append(mutant)
            reason = understood.get(mutant.key, "not understood")
            sys.stdout.write(f"survived, line {mutant.line}: {mutant.key}  ({reason})\n")
            sys.stdout.flush()
        if done % 20 == 0 or done == len(chosen):
            sys.stderr.write(f"{done} of {len(chosen)}, {len(survivors)} survived\n")
    return real, survivors


if __name__ == "__main__":
    sys.exit(main())
