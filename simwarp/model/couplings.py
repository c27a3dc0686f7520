"""Couplings: bilateral rows on the coordinates of joints, as a list of a builder."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Any, Final

from simwarp.core.constraints import Meaning, NotNegative
from simwarp.core.types import FLOAT32_LEAST, JointType, ModelError, RowKind, formatted
from simwarp.model.checks import checked_name, finite_number, index_within, whole_number
from simwarp.model.joint_types import ELEMENTS
from simwarp.model.rules import RULES, Name
from simwarp.model.specifications import CouplingSpec, JointSpec

MAX_COUPLING_TERMS: Final = 12


class CouplingList:
    """The couplings of a builder, which tie the coordinates of its joints."""

    def __init__(self) -> None:
        super().__init__()
        self.joints: list[JointSpec] = []
        self.couplings: list[CouplingSpec] = []

    @RULES.arguments("coupling '{name}'")
    def add_coupling(
        self, name: Name, terms: Iterable[tuple[int, float] | tuple[int, int, float]], *,
        offset: Annotated[float, Meaning("a number; None keeps the initial value")] | None = None,
        damping: Annotated[NotNegative, Meaning("N·m·s/rad; 0 holds it rigidly")] = 0.0,
    ) -> int:  # fmt: skip
        """One bilateral row on coordinates: sum of coefficient x q = offset (the initial value when None).

        Gears, racks, screws, belts and planetary sets are couplings: see `add_gear`, `add_rack`, `add_screw`.

        Args:
            terms: (joint, coefficient) or (joint, local dof, coefficient), at most twelve; a combination stands for
                its own terms.
            damping: of a viscous coupling, whose sum may slip [N·m·s/rad or N·s/m]; 0 holds it rigidly.

        Raises:
            ModelError: the name is taken, or the terms or a number are not usable.
        """
        thing = f"coupling '{name}'"
        if any(coupling.name == name for coupling in self.couplings):
            raise ModelError(f"{thing}: the name is taken by another coupling; choose one of its own")
        resolved = self._terms(thing, terms, "chain couplings")
        self.couplings.append(CouplingSpec(name, resolved, offset, damping))
        return len(self.couplings) - 1

    def add_gear(self, name: str, joint0: int, joint1: int, *, ratio: float) -> int:
        """Couples two shafts or hinges: q1 = ratio · q0; the ratio is negative for external teeth."""
        return self.add_coupling(name, [(joint0, ratio), (joint1, -1.0)])

    def add_rack(self, name: str, pinion: int, rack: int, *, radius: float) -> int:
        """Couples a rack to its pinion: q_rack = radius · q_pinion [m per rad]."""
        thing = checked_name("rack", name)
        self._check_kind(thing, "pinion", pinion, 0, lengths=False)
        self._check_kind(thing, "rack", rack, 0, lengths=True)
        return self.add_coupling(name, [(pinion, radius), (rack, -1.0)])

    @RULES.arguments("screw '{name}'")
    def add_screw(self, name: Name, cylindrical: int, *, lead: Annotated[float, Meaning("metres per turn")]) -> int:
        """The slide of a cylindrical joint advances `lead` [m] per turn.

        Raises:
            ModelError: the joint is not CYLINDRICAL, or `lead` is not finite.
        """
        thing = f"screw '{name}'"
        spec, _ = self._coordinate(thing, cylindrical, 0)
        if spec.type != JointType.CYLINDRICAL:
            raise ModelError(
                f"{thing}: joint must be CYLINDRICAL, got {spec.type.name} joint '{spec.name}'; "
                "use add_coupling for two joints"
            )
        return self.add_coupling(name, [(cylindrical, 0, -1.0), (cylindrical, 1, lead / (2.0 * math.pi))])

    @property
    def dof_count(self) -> int:
        """Number of joint coordinates: the second axis of `joint_q`."""
        return sum(len(ELEMENTS[joint.type].dofs) for joint in self.joints)

    def dof_start(self, joint: int) -> int:
        """First column of `joint_q` that belongs to `joint`; of the number of joints their total.

        Raises:
            ModelError: there is no such joint.
        """
        rule = f"joint must be in 0..{len(self.joints)}"
        index_within("dof_start", rule, joint, len(self.joints) + 1, "pass what add_joint_... returned")
        return sum(len(ELEMENTS[spec.type].dofs) for spec in self.joints[:joint])

    def coordinate_of(self, column: int) -> tuple[int, int]:
        """The joint and its local coordinate that a column of `joint_q` belongs to.

        Raises:
            ModelError: there is no such column.
        """
        remedy = "pass a column of joint_q, such as dof_start returns"
        left = whole_number("coordinate_of", "column", column, 0, self.dof_count - 1, remedy)
        for joint, spec in enumerate(self.joints):
            count = len(ELEMENTS[spec.type].dofs)
            if left < count:
                return joint, left
            left -= count
        raise AssertionError("the counts of the joints are those of dof_count")

    def _coordinate(self, thing: str, joint: Any, local: Any) -> tuple[JointSpec, int]:
        """A joint of this builder and an index of one of its coordinates."""
        rule = f"joint must be in 0..{len(self.joints) - 1}"
        spec = self.joints[index_within(thing, rule, joint, len(self.joints), "pass what add_joint_... returned")]
        count = len(ELEMENTS[spec.type].dofs)
        rule = f"an index of joint '{spec.name}', which has {count} coordinates, must be below that"
        return spec, index_within(thing, rule, local, count, "couple joints that have coordinates")

    def _terms(self, thing: str, terms: Any, remedy: str) -> tuple[tuple[int, float], ...]:
        """(public dof index, coefficient) of 1 to 12 terms; combinations are written out."""
        try:
            listed = list(terms)
        except TypeError:
            raise ModelError(
                f"{thing}: terms must be a list, got {formatted(terms)}; write [(joint, coefficient), ...]"
            ) from None
        resolved = tuple(part for term in listed for part in self._term(thing, term))
        if not 1 <= len(resolved) <= MAX_COUPLING_TERMS:
            raise ModelError(f"{thing}: needs 1 to {MAX_COUPLING_TERMS} terms, got {len(resolved)}; {remedy}")
        return resolved

    def _term(self, thing: str, term: Any) -> list[tuple[int, float]]:
        if not isinstance(term, Sequence) or isinstance(term, (str, bytes)) or len(term) not in (2, 3):
            raise ModelError(
                f"{thing}: a term must be (joint, coefficient) or (joint, local dof, coefficient), "
                f"got {formatted(term)}; "
                "pass a list of such tuples"
            )
        joint, local, coefficient = (term[0], 0, term[1]) if len(term) == 2 else term
        spec, _ = self._coordinate(thing, joint, local)
        factor = finite_number(thing, "coefficient (or ratio, radius, lead)", coefficient)
        if abs(factor) < FLOAT32_LEAST:
            raise ModelError(f"{thing}: coefficient must not be 0, got {formatted(coefficient)}; leave the term out")
        if spec.terms:
            return [(dof, factor * part) for dof, part in spec.terms]
        return [(self.dof_start(joint) + int(local), factor)]

    def _check_kind(self, thing: str, role: str, joint: int, local: int, lengths: bool) -> None:
        spec, index = self._coordinate(thing, joint, local)
        kind = ELEMENTS[spec.type].dofs[index].kind
        if (kind in (RowKind.POINT_AXIS0, RowKind.POINT_AXIS1, RowKind.DISTANCE)) != lengths:
            wanted = "a length (a prismatic joint)" if lengths else "an angle (a revolute joint or a shaft)"
            raise ModelError(
                f"{thing}: {role} must have {wanted} as coordinate, got {spec.type.name} joint '{spec.name}'; "
                "use add_coupling for anything else"
            )
