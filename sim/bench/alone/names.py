"""Networks as methods of the benchmark: `network` is the packaged one, `network@DIR` that of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from labr_autonomy.errors import BadInput
from labr_autonomy.gkpn.package import ONNX_NAME, packaged_dir, read_manifest

NAME, AT = "network", "@"
HOW = f"{NAME} (the packaged weights), {NAME}{AT}DIR"


def is_network(method: str) -> bool:
    """Whether a method's name is that of a network flown alone."""
    return method == NAME or method.startswith(NAME + AT)


def method_of(folder: Path) -> str:
    """The method that flies a weights' folder."""
    return f"{NAME}{AT}{folder}"


def folder_of(method: str) -> Path:
    """Where the weights of such a method are.

    Raises:
        BadInput: when the name has no folder behind the sign.
    """
    if method == NAME:
        return packaged_dir()
    path = method.removeprefix(NAME + AT)
    if not path:
        raise BadInput(f"the method '{method}' names no folder", f"Say {HOW}")
    return Path(path)


def manifest_of(method: str) -> dict[str, Any]:
    """The manifest of a network's weights.

    Raises:
        BadInput: when there is none that can be read.
    """
    return read_manifest(folder_of(method))


def digest_of(method: str) -> str:
    """What the weights of a network are known by: the sha256 of its model, as the manifest lists it."""
    files = manifest_of(method).get("files", {})
    return str(files.get(ONNX_NAME, {}).get("sha256", ""))
