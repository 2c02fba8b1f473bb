"""Training the benchmark's iPlanner (`python -m sim.bench.iplanner.train`), by GKPN's loop with its own loss.

The data comes from `python -m sim.dataset FILE.npz --size 320 180 --land`.

Depth, goal and key points are in metres, as published. In units of 10 m, which suit GKPN, the goal moves the
first convolution of the decoder 50 times less than the image does (5 times in metres), and it learns later:
after the same 2,000 images and 24,000 goals the loss was 11.9 instead of 10.5.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from labr_autonomy.gkpn import dataset
from labr_autonomy.gkpn.iplanner import IPlannerConfig
from labr_autonomy.gkpn.iplanner_loss import IPlannerLoss
from labr_autonomy.gkpn.train import TrainConfig, run_facts, train


def settings(
    steps: int, rate: float, unit_m: float, inflate_m: float, seed: int, threads: int
) -> TrainConfig:
    """One run: few images a step, for the encoder is the costly part, and twelve goals of each."""
    return TrainConfig(
        steps=steps,
        batch=4,
        goals=12,
        rate=rate,
        seed=seed,
        threads=threads,
        bfloat16=False,
        save_every=50,
        network=IPlannerConfig(unit_m=unit_m),
        loss=IPlannerLoss(inflate_m=inflate_m),
    )


def main() -> None:
    """Train from files and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="training sets (.npz)")
    parser.add_argument("--validation", type=Path, required=True, help="set of unseen scenes (.npz)")
    parser.add_argument("--run", type=Path, required=True, help="folder for checkpoints")
    parser.add_argument("--weights", type=Path, help="folder to export to when done")
    parser.add_argument("--steps", type=int, default=5000)
    parser.add_argument("--rate", type=float, default=1e-3, help="peak of the learning rate")
    parser.add_argument("--unit", type=float, default=1.0, help="unit of depth, goal and key points [m]")
    parser.add_argument("--inflate", type=float, default=IPlannerLoss().inflate_m, help="of obstacles [m]")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    a = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    config = settings(a.steps, a.rate, a.unit, a.inflate, a.seed, a.threads)
    training, validation = dataset.load(*a.data), dataset.load(a.validation)
    net = train(training, validation, a.run, config)
    if a.weights:
        from sim.bench.iplanner.export import export

        export(net, a.weights, validation, run_facts(a.run, config, training, validation))


if __name__ == "__main__":
    main()
