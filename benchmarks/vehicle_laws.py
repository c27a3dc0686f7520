"""Errors of vehicles against the laws of docs/vehicles.md: the figures behind the bounds of tests/physics.

Run: python benchmarks/vehicle_laws.py            all, some four minutes
     python benchmarks/vehicle_laws.py power      one of them
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from simwarp.vehicle.driving.drivers import ScriptSpec  # noqa: E402
from simwarp.vehicle.spec.mirroring import mirrored  # noqa: E402
from simwarp.vehicle.spec.variants import with_options  # noqa: E402
from tests.physics import (  # noqa: E402
    test_vehicle_laws as laws,
    test_vehicle_mirror as mirror,
)
from tests.physics.sample_vehicles import shipped  # noqa: E402
from tests.physics.vehicle_energy import Ledger, body_momenta, sample  # noqa: E402


def power() -> None:
    print("power: coasting from 15 m/s, energy lost in 4 s and what of it is not accounted for")
    for name, engine, gear in (("hmmwv-reduced", False, None), ("hmmwv-reduced", True, None), ("gator", False, None)):
        for settled in (True, False):
            lost, work = laws.coast(name, engine, gear, settled)
            how = "settled" if settled else "with the drop onto the wheels"
            with_engine = "against its engine" if engine else "without engine"
            print(f"  {name}, {with_engine}, {how}: {lost:.0f} J, {abs(lost + work.sum()) / lost:.1e}")


def standstill() -> None:
    print("standstill: way on a slope of 20 % from 3 s to 60 s, full brakes, 1 ms")
    cases = [("hmmwv", tire) for tire in laws.MODELS]
    cases += [(name, "tmeasy") for name in ("hmmwv-reduced", "gator", "artcar", "sedan")]
    for name, tire in cases:
        print(f"  {name}, {tire}: {1e3 * laws.creep(with_options(shipped(name), tire=tire), 60.0, 1e-3):.3f} mm")


def joints() -> None:
    print("joints: largest error in ten seconds, the second ten and the last ten of ten minutes, 2 ms")
    for name, speed in laws.LONG:
        worst, _, _ = laws.ten_minutes(name, speed)
        (early, early_rows), (late, late_rows) = worst[1], worst[-1]
        print(f"  {name}: {early:.1e} and {late:.1e} m or rad; rows {early_rows:.1e} and {late_rows:.1e} m/s")


def steps() -> None:
    print("steps: steady yaw rate against that of 1 ms")
    for name, speed in (*laws.LONG, ("sedan", 12.0)):
        fine = laws.steady_yaw_rate(name, speed, 1e-3)
        others = [f"{dt * 1e3:g} ms {laws.steady_yaw_rate(name, speed, dt) / fine - 1.0:+.1e}" for dt in (2e-3, 3e-3)]
        print(f"  {name}: {fine:.4f} rad/s; {', '.join(others)}")


def images() -> None:
    print("mirror images: largest difference over the size of its column, 5 s of a step steer")
    for name, speed in (("hmmwv", 12.0), ("hmmwv-reduced", 12.0), ("gator", 6.0)):
        spec = mirror.lopsided(shipped(name))
        run, image = mirror.step_steer(spec, 0.3, speed), mirror.step_steer(mirrored(spec), -0.3, speed)
        found = mirror.apart(run, image)
        print(f"  {name}: y {found['y_m']:.1e}, yaw {found['yaw_rad']:.1e}, loads {found['Fz_FL_N']:.1e}")


def momentum() -> None:
    print("momentum: change over its size, floating, wheels at 32 rad/s braked to a stop, engine running")
    for name in ("hmmwv", "hmmwv-reduced"):
        script: ScriptSpec = laws.BRAKED
        builder, _, _, sim = laws.start(laws.weightless(name, engine=True), 15.0, script, floating=True)
        ledger = Ledger(builder)
        before = body_momenta(ledger, sample(sim))
        for _ in range(2000):
            sim.step()
        after = body_momenta(ledger, sample(sim))
        changes = [np.linalg.norm(b - a) / np.linalg.norm(a) for a, b in zip(before, after, strict=True)]
        print(f"  {name}: linear {changes[0]:.1e}, angular {changes[1]:.1e}")


LAWS: dict[str, Callable[[], None]] = {
    "power": power, "standstill": standstill, "joints": joints, "steps": steps, "mirror": images,
    "momentum": momentum,
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("law", nargs="*", help=f"of {', '.join(LAWS)}")
    chosen = parser.parse_args().law or list(LAWS)
    for name in chosen:
        if name not in LAWS:
            raise SystemExit(f"law: must be one of {', '.join(LAWS)}, got {name!r}")
    for name in chosen:
        LAWS[name]()


if __name__ == "__main__":
    main()
