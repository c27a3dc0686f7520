"""The arrays of a simulation, declared once: parameters of a model, state, control, contacts, reports.

`Model`, `State`, `Control`, `Contacts` and `Diagnostics` inherit these attributes; the structs that kernels take are
made of them. A new array is one line here, and its use. Arrays of parameters begin with the attribute of a builder's
items that `source` names.
"""

from __future__ import annotations

import warp as wp

from simwarp.core.arrays import NOT_NEGATIVE, POSITIVE, Domain, WritableArray
from simwarp.core.fields import FieldGroup, Size, field, parameter, struct_of

A_LIMIT = Domain(remedy="1e30 and -1e30 stand for no limit")
AN_EFFORT = Domain(least=0.0, remedy="1e30 stands for no limit")


# fmt: off
class ParameterFields(FieldGroup):
    """Parameters that may differ per world: one row for all worlds, or one each."""

    gravity: WritableArray = parameter(wp.vec3, text="acceleration [m/s²], world frame")
    body_mass: WritableArray = parameter(wp.float32, Size.BODIES, source="body.mass", domain=POSITIVE, text="[kg]")
    body_inertia_b: WritableArray = parameter(
        wp.mat33, Size.BODIES, source="body.inertia", domain=POSITIVE,
        text="about the centre of mass, body frame [kg·m²]",
    )
    joint_anchor0: WritableArray = parameter(
        wp.vec3d, Size.JOINTS, source="joint.frame0.position",
        text="origin of frame 0 from the first body's centre, its frame [m]",
    )
    joint_anchor1: WritableArray = parameter(
        wp.vec3d, Size.JOINTS, source="joint.frame1.position",
        text="origin of frame 1 from the second body's centre, its frame [m]",
    )
    joint_frame0: WritableArray = parameter(
        wp.mat33d, Size.JOINTS, text="axes of frame 0 in the first body, as columns"
    )
    joint_frame1: WritableArray = parameter(
        wp.mat33d, Size.JOINTS, text="axes of frame 1 in the second body, as columns"
    )
    joint_offset: WritableArray = parameter(
        wp.float64, Size.JOINTS, source="joint.offset",
        text="length of a massless link, or of an elastic joint at rest [m]",
    )
    joint_armature: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=NOT_NEGATIVE,
        text="inertia along the coordinate, of a shaft its own included [kg or kg·m²]",
    )
    joint_stiffness: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=NOT_NEGATIVE,
        text="of the spring along the coordinate [N/m or N·m/rad]; of one by table, the factor of its efforts, "
        "1 as built",
    )
    joint_rest: WritableArray = parameter(
        wp.float32, Size.DOFS, source="dof.rest", text="coordinate at which the spring is at rest [m or rad]"
    )
    joint_damping: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=NOT_NEGATIVE,
        text="of the damper along the coordinate [N·s/m or N·m·s/rad]; of one by table or map, the factor of its "
        "efforts, 1 as built",
    )
    joint_preload: WritableArray = parameter(
        wp.float32, Size.DOFS, source="dof.preload", text="effort of the spring at rest [N or N·m]"
    )
    joint_friction: WritableArray = parameter(
        wp.float32, Size.DOFS, source="dof.friction", domain=NOT_NEGATIVE, text="dry friction [N or N·m]"
    )
    joint_limit_lower: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=A_LIMIT, text="lower stop, -1e30 stands for none [m or rad]"
    )
    joint_limit_upper: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=A_LIMIT, text="upper stop, 1e30 stands for none [m or rad]"
    )
    drive_stiffness: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=NOT_NEGATIVE, text="of position drives [N/m or N·m/rad]"
    )
    drive_damping: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=NOT_NEGATIVE, text="of position drives [N·s/m or N·m·s/rad]"
    )
    drive_effort_limit: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=AN_EFFORT, text="largest effort of a drive, 1e30 stands for none [N or N·m]"
    )
    drive_effort_lower: WritableArray = parameter(
        wp.float32, Size.DOFS, domain=A_LIMIT,
        text="least effort of a drive, -1e30 stands for none, a positive one for -`drive_effort_limit` [N or N·m]",
    )
    coupling_coefficient: WritableArray = parameter(
        wp.float32, Size.COUPLINGS, Size.TERMS,
        text="factors of the coordinates, as many terms as the longest has; combinations follow the couplings",
    )
    coupling_offset: WritableArray = parameter(
        wp.float64, Size.COUPLINGS, text="sum of factors x coordinates that a coupling holds"
    )
    coupling_damping: WritableArray = parameter(
        wp.float32, Size.COUPLINGS, source="coupling.damping", domain=NOT_NEGATIVE,
        text="of a viscous coupling, 0: rigid [N·m·s/rad]",
    )
    flexible_young: WritableArray = parameter(
        wp.float32, Size.MESH_PARTS, domain=POSITIVE, of_kernels=False,
        text="Young's modulus of each part of the flexible meshes [Pa]",
    )
    flexible_damping_time: WritableArray = parameter(
        wp.float32, Size.MESH_PARTS, domain=NOT_NEGATIVE, of_kernels=False,
        text="stress per strain rate over stress per strain [s]",
    )
    flexible_thickness: WritableArray = parameter(
        wp.float32, Size.MESH_PARTS, domain=NOT_NEGATIVE, of_kernels=False,
        text="of sheets, whose mass it leaves alone [m]; 0 for solids",
    )
    flexible_pressure: WritableArray = parameter(
        wp.float32, Size.MESH_PARTS, of_kernels=False, text="that pushes sheets along their normals [Pa]"
    )
    shape_x: WritableArray = parameter(
        wp.vec3d, Size.SHAPES, source="shape.pose.position",
        text="origin from the body's centre of mass, body axes [m]",
    )
    shape_rot: WritableArray = parameter(
        wp.quat, Size.SHAPES, source="shape.pose.rotation", text="xyzw, shape axes to body axes"
    )
    shape_size: WritableArray = parameter(
        wp.vec3, Size.SHAPES, source="shape.size", domain=NOT_NEGATIVE, text="meaning by `ShapeType` [m]"
    )
    shape_margin: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.margin", domain=NOT_NEGATIVE, text="thickness added to the surface [m]"
    )
    shape_asset: WritableArray = parameter(
        wp.int32, Size.SHAPES, source="shape.asset", text="asset that a hull, height field, mesh or sprocket shows"
    )
    shape_enabled: WritableArray = parameter(wp.int32, Size.SHAPES, text="0 takes the shape out")
    shape_friction: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.friction", domain=NOT_NEGATIVE,
        text="coefficient of Coulomb friction",
    )
    shape_rolling_friction: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.rolling_friction", domain=NOT_NEGATIVE,
        text="lever of rolling friction [m]",
    )
    shape_spinning_friction: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.spinning_friction", domain=NOT_NEGATIVE,
        text="lever of spinning friction [m]",
    )
    shape_restitution: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.restitution", domain=Domain(0.0, 1.0),
        text="coefficient of restitution",
    )
    shape_cohesion: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.cohesion", domain=NOT_NEGATIVE,
        text="force that holds contacts together [N]",
    )
    shape_compliance: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.compliance", domain=NOT_NEGATIVE,
        text="penetration per normal force [m/N]",
    )
    shape_damping: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.damping", domain=NOT_NEGATIVE,
        text="relaxation time of the compliance [s]",
    )
    shape_young_modulus: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.young_modulus", domain=NOT_NEGATIVE,
        text="of the smooth contact model [Pa]",
    )
    shape_poisson_ratio: WritableArray = parameter(
        wp.float32, Size.SHAPES, source="shape.material.poisson_ratio", domain=Domain(0.0, 0.5),
        text="of the smooth contact model",
    )


class StateFields(FieldGroup):
    """State that a step advances. Angular and linear parts are separate arrays; everything is in the world frame."""

    body_x: WritableArray = field(
        wp.vec3d, Size.WORLDS, Size.BODIES, writable=True, text="position of record of the centre of mass [m]"
    )
    body_rot: WritableArray = field(
        wp.quatd, Size.WORLDS, Size.BODIES, writable=True, text="orientation of record, xyzw"
    )
    body_q: WritableArray = field(
        wp.transform, Size.WORLDS, Size.BODIES, writable=True, text="view of both for reading, published by each step"
    )
    body_v: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="velocity of the centre of mass [m/s], world"
    )
    body_omega: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="angular velocity [rad/s], world"
    )
    body_omega_last: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True,
        text="the same one sub-step before; the gyroscopic torque extrapolates [rad/s], world",
    )
    body_v_low: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True,
        text="what float32 rounding kept back from `body_v` (compensated summation) [m/s], world",
    )
    body_omega_low: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="the same of `body_omega` [rad/s], world"
    )
    joint_x: WritableArray = field(
        wp.float64, Size.WORLDS, Size.DOFS, writable=True, text="coordinates of record, turns counted"
    )
    joint_q: WritableArray = field(wp.float32, Size.WORLDS, Size.DOFS, writable=True, text="the same in float32")
    joint_qd: WritableArray = field(wp.float32, Size.WORLDS, Size.DOFS, writable=True, text="rates")
    box_impulse: WritableArray = field(
        wp.float32, Size.WORLDS, Size.BOX_CONSTRAINTS, writable=True,
        text="warm start of limits, friction, motors and drives [N·s or N·m·s]",
    )
    world_time: WritableArray = field(wp.float64, Size.WORLDS, writable=True, text="time since the last reset [s]")
    world_status: WritableArray = field(wp.int32, Size.WORLDS, writable=True, text="bits, see below")


class ControlFields(FieldGroup):
    """Inputs of a step, kept until they are written again."""

    joint_force: WritableArray = field(
        wp.float32, Size.WORLDS, Size.DOFS, writable=True, text="force or torque along each coordinate [N or N·m]"
    )
    joint_target_q: WritableArray = field(
        wp.float32, Size.WORLDS, Size.DOFS, writable=True,
        text="target of position drives and of prescribed positions without a table",
    )
    joint_target_qd: WritableArray = field(
        wp.float32, Size.WORLDS, Size.DOFS, writable=True,
        text="target rate of drives, motors and prescribed motions without a table",
    )
    body_force: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="at the centre of mass, world axes [N]"
    )
    body_torque: WritableArray = field(wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="world axes [N·m]")
    body_force_b: WritableArray = field(
        wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="at the centre of mass, body axes [N]"
    )
    body_torque_b: WritableArray = field(wp.vec3, Size.WORLDS, Size.BODIES, writable=True, text="body axes [N·m]")
    element_force: WritableArray = field(
        wp.vec3, Size.ELEMENT_WORLDS, Size.BODIES, writable=True,
        text="written by force elements such as tires, at the centre of mass, world axes [N]",
    )
    element_torque: WritableArray = field(
        wp.vec3, Size.ELEMENT_WORLDS, Size.BODIES, writable=True, text="the same [N·m]"
    )
    element_joint_force: WritableArray = field(
        wp.float32, Size.ELEMENT_WORLDS, Size.DOFS, writable=True, text="the same along coordinates [N or N·m]"
    )
    element_mass: WritableArray = field(
        wp.mat33, Size.IMPLICIT_WORLDS, Size.BODIES, writable=True, transient=True,
        text="of elements whose force falls with the change of velocity in the step: impulse per velocity [kg]",
    )
    element_coupling: WritableArray = field(
        wp.mat33, Size.IMPLICIT_WORLDS, Size.BODIES, writable=True, transient=True,
        text="moment's impulse per velocity [kg·m]",
    )
    element_inertia: WritableArray = field(
        wp.mat33, Size.IMPLICIT_WORLDS, Size.BODIES, writable=True, transient=True,
        text="moment's impulse per angular velocity [kg·m²]",
    )


class ContactFields(FieldGroup):
    """The contacts of the last sub-step, at the poses of its start."""

    contact_count: wp.array = field(wp.int32, Size.WORLDS, text="slots in use")
    contact_overflow: wp.array = field(wp.int32, Size.WORLDS, text="shallow contacts left out for want of slots")
    contact_shape0: wp.array = field(wp.int32, Size.WORLDS, Size.CONTACTS, text="the shape of smaller index")
    contact_shape1: wp.array = field(wp.int32, Size.WORLDS, Size.CONTACTS, text="the other")
    contact_feature: wp.array = field(
        wp.int32, Size.WORLDS, Size.CONTACTS, text="tells the contacts of a pair apart from step to step"
    )
    contact_normal_w: wp.array = field(wp.vec3, Size.WORLDS, Size.CONTACTS, text="from shape 0 to shape 1, world axes")
    contact_gap: wp.array = field(wp.float32, Size.WORLDS, Size.CONTACTS, text="negative is penetration [m]")
    contact_arm0: wp.array = field(
        wp.vec3, Size.WORLDS, Size.CONTACTS,
        text="from the centre of mass of shape 0's body (the world's origin) to its contact point [m]",
    )
    contact_arm1: wp.array = field(wp.vec3, Size.WORLDS, Size.CONTACTS, text="the same of shape 1")
    contact_face: wp.array = field(
        wp.int32, Size.WORLDS, Size.FACE_CONTACTS,
        text="triangle of a mesh that it is on, a row of `Model.face_bodies`; -1: none",
    )
    contact_weights: wp.array = field(
        wp.vec3, Size.WORLDS, Size.FACE_CONTACTS, text="shares of that triangle's corners, which sum to 1"
    )
    contact_impulse: wp.array = field(
        wp.vec3, Size.WORLDS, Size.CONTACTS, text="along the normal and two tangents [N·s]"
    )
    contact_moment: wp.array = field(
        wp.vec3, Size.WORLDS, Size.CONTACTS,
        text="about the two tangents and the normal, of rolling and spinning friction [N·m·s]",
    )
    contact_force_w: wp.array = field(wp.vec3, Size.WORLDS, Size.CONTACTS, text="on shape 1, world axes [N]")
    shape_contact_force: wp.array = field(
        wp.vec3, Size.WORLDS, Size.SHAPES, text="sum over a shape's contacts, world axes [N]"
    )
    body_contact_force: wp.array = field(
        wp.vec3, Size.WORLDS, Size.TOUCHED_BODIES, text="the same over a body's shapes [N]"
    )
    penetration: wp.array = field(wp.float32, Size.WORLDS, text="the deepest [m]")


class ReportFields(FieldGroup):
    """Diagnostics of the last sub-step."""

    row_residual: wp.array = field(
        wp.float32, Size.WORLDS, text="largest speed error of the loop and coupling rows [m/s or rad/s]"
    )
    cone_residual: wp.array = field(
        wp.float32, Size.WORLDS, text="largest natural residual of limits, friction, motors and contacts [m/s or rad/s]"
    )
    constraint_count: wp.array = field(wp.int32, Size.WORLDS, text="rows on coordinates and contacts that took part")
    iterations: wp.array = field(wp.int32, Size.WORLDS, text="iterations of their solve, of the island that takes most")
    position_error: wp.array = field(
        wp.float32, Size.WORLDS,
        text="largest joint violation [m or rad]: at the step's start, or before the last pass when "
        "positions are projected",
    )
    joint_reaction_force: wp.array = field(
        wp.vec3, Size.REACTION_WORLDS, Size.JOINTS, text="force on the second body [N], world axes"
    )
    joint_reaction_torque: wp.array = field(
        wp.vec3, Size.REACTION_WORLDS, Size.JOINTS,
        text="torque on the second body about anchor 1 [N·m], world axes; along a shaft in x",
    )
    joint_qdd: wp.array = field(
        wp.float32, Size.ACCELERATION_WORLDS, Size.DOFS,
        text="accelerations along the coordinates [m/s² or rad/s²], in the axes of `joint_qd`",
    )
    energy: wp.array = field(
        wp.float64, Size.WORLDS, of_kernels=False,
        text="mechanical energy as of the last `Simulation.measure_energy`, springs of joints included [J]",
    )


# fmt: on
Parameters = struct_of(ParameterFields, "Parameters", __name__)
StateArrays = struct_of(StateFields, "StateArrays", __name__)
ControlArrays = struct_of(ControlFields, "ControlArrays", __name__)
ContactArrays = struct_of(ContactFields, "ContactArrays", __name__)
Reports = struct_of(ReportFields, "Reports", __name__)
