"""The shipped vehicles, one line each."""

from __future__ import annotations

from simwarp.vehicle.spec.tracked_vehicle_spec import AnyVehicleSpec, TrackedVehicleSpec
from simwarp.vehicle.spec.variants import KINDS, option_names
from simwarp.vehicle.tracks.tracked_files import all_vehicle_names, load_any_vehicle

_SUSPENSIONS = {
    "beam-axle": "a beam axle",
    "double-wishbone": "double wishbones",
    "double-wishbone-reduced": "double wishbones (reduced)",
    "macpherson-strut": "MacPherson struts",
    "multi-link": "multi-link",
    "pinned-axle": "a pinned axle",
    "rigid-suspension": "no springs",
    "single-wishbone": "single wishbones",
    "solid-axle": "a solid axle",
    "tabulated": "tables of suspensions (reduced)",
    "three-link": "trailing arms on three links",
    "trailing-arm": "trailing arms",
}


def catalogue() -> dict[str, str]:
    """Name -> what it is, with the names of its options; those on tracks come last."""
    return {name: describe(load_any_vehicle(name)) for name in all_vehicle_names()}


def describe(spec: AnyVehicleSpec) -> str:
    """Suspensions or tracks, chassis mass and the names that `--tire`, `--powertrain` and `--driveline` take."""
    if isinstance(spec, TrackedVehicleSpec):
        kinds = [f"tracks of {spec.left.shoes} and {spec.right.shoes} shoes"]
    else:
        templates = [getattr(axle.suspension, "template", "") for axle in spec.all_axles]
        kinds = list(dict.fromkeys(_SUSPENSIONS.get(template, template) for template in templates))
    mass = sum(part.mass for part in spec.chassis.components)
    parts = [f"{', '.join(kinds)}, chassis {mass:.4g} kg"]
    for trailer in () if isinstance(spec, TrackedVehicleSpec) else spec.trailers:
        pulled = sum(part.mass for part in trailer.chassis.components)
        parts.append(f"trailer of {pulled:.4g} kg on a {trailer.hitch.kind.replace('-', ' ')}")
    for kind in KINDS:
        names = option_names(spec.name, kind)
        if names:
            parts.append(f"{kind} {'|'.join(names)}")
    return "; ".join(parts)
