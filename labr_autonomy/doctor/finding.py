"""One line of the doctor's report."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal

from labr_autonomy.errors import LabrError

AREAS = ("machine", "ports", "camera", "vio", "ground", "air", "cpu")
State = Literal["good", "wrong", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at and how it is."""

    area: str  # one of AREAS
    name: str
    state: State  # "note" is worth knowing and keeps nobody on the floor
    text: str  # how it is, with figures
    do: str = ""  # what to do about it

    def as_dict(self) -> dict[str, str]:
        """For machines."""
        return asdict(self)

    @property
    def line(self) -> str:
        """For people."""
        remedy = f" {self.do}" if self.do and self.state != "good" else ""
        stop = "." if remedy and not self.text.endswith(".") else ""
        return f"{self.state:5s}  {self.area:7s}  {self.name}: {self.text}{stop}{remedy}"


def good(area: str, name: str, text: str) -> Finding:
    """All is well."""
    return Finding(area, name, "good", text)


def wrong(area: str, name: str, text: str, do: str) -> Finding:
    """Something must be done."""
    return Finding(area, name, "wrong", text, do)


def note(area: str, name: str, text: str, do: str = "") -> Finding:
    """Worth knowing."""
    return Finding(area, name, "note", text, do)


def failed(area: str, name: str, error: LabrError) -> Finding:
    """What an error says."""
    return Finding(area, name, "wrong", error.what, error.do or "Look at the logs.")
