"""What a run computes on: one process or several (`torchrun`), a GPU if there is one, bfloat16 if quick."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import timedelta
from typing import Literal

import torch
from torch import distributed, nn

PATIENCE = timedelta(hours=12)  # that processes wait for the one that makes data or flies


@dataclass(frozen=True, slots=True)
class Machine:
    """This process among its likes."""

    device: torch.device
    rank: int
    world: int  # processes in all
    bfloat16: bool

    @property
    def leads(self) -> bool:
        """Whether this is the process that writes files and speaks."""
        return self.rank == 0

    @property
    def memory_format(self) -> torch.memory_format:
        """Channels last is quicker; in float32 oneDNN's gradients of 1x1 strides crash on some processors."""
        quick = self.bfloat16 or self.device.type == "cuda"
        return torch.channels_last if quick else torch.contiguous_format

    def share(self, count: int) -> int:
        """This process' part of a batch."""
        return count // self.world + (self.rank < count % self.world)

    def spread(self, net: nn.Module) -> nn.Module:
        """The network such that gradients are means over all processes."""
        if self.world == 1:
            return net
        return nn.parallel.DistributedDataParallel(net)

    def wait(self) -> None:
        """Until every process is here."""
        if self.world > 1:
            distributed.barrier()


def find_machine(precision: Literal["auto", "float32", "bfloat16"], threads: int) -> Machine:
    """The machine as `torchrun` describes it in the environment; alone without it.

    Args:
        precision: Of convolutions and matrix products; "auto" is bfloat16 where the processor has it.
        threads: Of this process; 0 for all.
    """
    rank, world = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
    gpu = torch.cuda.is_available()
    if world > 1 and not distributed.is_initialized():
        distributed.init_process_group("nccl" if gpu else "gloo", timeout=PATIENCE)
    local = int(os.environ.get("LOCAL_RANK", "0"))
    device = torch.device("cuda", local % torch.cuda.device_count()) if gpu else torch.device("cpu")
    if threads:
        torch.set_num_threads(threads)
    torch.use_deterministic_algorithms(True, warn_only=True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # a debugging aid, 6 % of a step
    quick = torch.cuda.is_bf16_supported() if gpu else _processor_has_bfloat16()
    return Machine(device, rank, world, precision == "bfloat16" or (precision == "auto" and quick))


def _processor_has_bfloat16() -> bool:
    """Whether bfloat16 is computed, not emulated."""
    return bool(torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported())
