"""The error of studies."""

from simwarp.vehicle.spec.vehicle_spec import SpecError


class StudyError(SpecError):
    """A study cannot be made as it is asked for; one line says why."""
