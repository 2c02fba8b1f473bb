"""The weights' folder: gkpn.onnx, gkpn.safetensors and manifest.json, which holds the sha256 of both."""

from __future__ import annotations

import hashlib
import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from labr_autonomy.errors import BadInput

ONNX_NAME, TENSORS_NAME, MANIFEST_NAME = "gkpn.onnx", "gkpn.safetensors", "manifest.json"
FORMAT = 1
RuntimeName = Literal["onnxruntime", "openvino"]
REMEDY = "Restore the folder from the repository, or train anew: labr-mission train shipped --weights DIR"


def packaged_dir() -> Path:
    """The weights that come with the package."""
    return Path(__file__).parent / "weights"


def check_runtime(name: RuntimeName) -> None:
    """Refuse a runtime that is not installed, with `BadInput`."""
    if find_spec(name) is None:
        raise BadInput(
            f"the network is to run on {name}, which is not installed",
            f"pip install 'labr-autonomy[{name}]', or leave network.runtime out of robot.yaml.",
        )


def sha256_hex(content: bytes) -> str:
    """Digest as written in the manifest."""
    return hashlib.sha256(content).hexdigest()


def read_manifest(weights_dir: Path, remedy: str = REMEDY) -> dict[str, Any]:
    """The manifest, refused in one sentence when it is missing, unreadable or of another format."""
    path = weights_dir / MANIFEST_NAME
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"the network's manifest {path} cannot be read ({error.strerror})", remedy) from None
    except ValueError as error:
        raise BadInput(f"the network's manifest {path} is not JSON ({error})", remedy) from None
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise BadInput(f"the network's manifest {path} is not of format {FORMAT}", remedy)
    return manifest


def read_verified(weights_dir: Path, name: str, remedy: str = REMEDY) -> bytes:
    """Content of a weights file whose sha256 is the manifest's; anything else is refused."""
    files = read_manifest(weights_dir, remedy).get("files", {})
    expected = files.get(name, {}).get("sha256")
    if not expected:
        raise BadInput(f"the network's manifest in {weights_dir} does not list {name}", remedy)
    path = weights_dir / name
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BadInput(f"the network's weights {path} cannot be read ({error.strerror})", remedy) from None
    found = sha256_hex(content)
    if found != expected:
        raise BadInput(
            f"the network's weights {path} are damaged: sha256 {found[:12]}, not {expected[:12]} as listed",
            remedy,
        )
    return content


def write_manifest(weights_dir: Path, facts: dict[str, Any]) -> None:
    """Write the manifest for the files of the folder, with further facts."""
    files = {}
    for name in (ONNX_NAME, TENSORS_NAME):
        content = (weights_dir / name).read_bytes()
        files[name] = {"sha256": sha256_hex(content), "bytes": len(content)}
    text = json.dumps({"format": FORMAT, "files": files, **facts}, indent=1)
    (weights_dir / MANIFEST_NAME).write_text(text + "\n", encoding="utf-8")
