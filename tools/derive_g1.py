"""Write hotice/model/g1.xml: published masses, inertias and joints of the G1, our own primitive geometry.

    python tools/derive_g1.py

Reads `g1_29dof_rev_1_0.urdf` of the `example-robot-data` package through Pinocchio, which merges the links behind fixed
joints (logo, head, hands, sensors) into the body that carries them. Geometry, sites, armature and actuators are the
tables below. Lengths in metres, in the frame of the body that the row names; rows of the left side are mirrored in y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

OUT = Path(__file__).parents[1] / "hotice" / "model" / "g1.xml"

# body -> primitives: capsule (radius, end, end), sphere (radius, centre), box (half extents, centre)
GEOMETRY: dict[str, list[tuple]] = {
    "pelvis": [("box", (0.055, 0.066, 0.076), (0.001, 0, -0.076))],
    "waist_yaw_link": [("capsule", 0.042, (0, 0, 0.010), (0, 0, 0.044))],
    "waist_roll_link": [("sphere", 0.018, (0, 0, 0))],
    "torso_link": [
        ("box", (0.073, 0.105, 0.141), (0.006, 0, 0.139)),
        ("capsule", 0.040, (0, -0.045, 0.274), (0, 0.045, 0.274)),
        ("capsule", 0.052, (0, 0, 0.330), (0.004, 0, 0.400)),
        ("capsule", 0.056, (-0.004, 0, 0.430), (0.020, 0, 0.430)),
    ],
    "left_hip_pitch_link": [("capsule", 0.047, (0, 0.022, -0.016), (0, 0.056, -0.032))],
    "left_hip_roll_link": [("capsule", 0.050, (0.050, 0, -0.004), (0.028, 0, -0.096))],
    "left_hip_yaw_link": [("capsule", 0.050, (0, 0, -0.030), (-0.076, -0.004, -0.178))],
    "left_knee_link": [
        ("capsule", 0.047, (0.013, 0, -0.005), (0.012, 0, -0.160)),
        ("capsule", 0.029, (0.011, 0, -0.160), (0.008, 0, -0.288)),
    ],
    "left_ankle_pitch_link": [("sphere", 0.019, (-0.006, 0, -0.006))],
    "left_ankle_roll_link": [
        ("box", (0.104, 0.038, 0.0125), (0.038, 0, -0.0225)),
        ("capsule", 0.026, (-0.030, 0, -0.002), (0.060, 0, -0.002)),
    ],
    "left_shoulder_pitch_link": [("capsule", 0.040, (0, 0.032, -0.004), (0, 0.044, -0.008))],
    "left_shoulder_roll_link": [("capsule", 0.041, (0, 0.005, -0.002), (0, 0.006, -0.070))],
    "left_shoulder_yaw_link": [("capsule", 0.037, (0, 0, 0), (0.008, -0.009, -0.082))],
    "left_elbow_link": [("capsule", 0.035, (0.002, 0.006, -0.005), (0.070, 0.001, -0.010))],
    "left_wrist_roll_link": [("capsule", 0.030, (0.010, 0, 0), (0.040, 0, 0))],
    "left_wrist_pitch_link": [("capsule", 0.029, (0, 0, 0), (0.050, 0, 0))],
    "left_wrist_yaw_link": [
        ("capsule", 0.030, (0, 0, 0), (0.020, 0, 0)),
        ("box", (0.050, 0.017, 0.039), (0.091, 0.005, -0.001)),
        ("capsule", 0.020, (0.152, -0.020, -0.024), (0.152, -0.020, 0.018)),  # fingers, half closed
        ("capsule", 0.014, (0.088, 0.006, 0.040), (0.122, -0.010, 0.050)),  # thumb
    ],
}

# geometry that the carried object may lean against (the rest of the body ignores it, which keeps contact detection
# cheap)
TRUNK = ("pelvis", "torso_link", "left_hip_yaw_link", "right_hip_yaw_link")

# geometry that the floor does not meet: of a standing foot, which stands on its soles
OFF_FLOOR = ("ankle_roll_link_0", "ankle_roll_link_1", "ankle_pitch_link_0")

# contact spheres: what carries load while the robot stands and holds (floor and object)
SOLE = (
    "left_ankle_roll_link",
    0.005,
    [(-0.05, 0.025, -0.030), (-0.05, -0.025, -0.030), (0.12, 0.030, -0.030), (0.12, -0.030, -0.030)],
)
PALM = ("left_wrist_yaw_link", 0.020, [(x, -0.015, z) for x in (0.060, 0.140) for z in (-0.025, 0.025)])

# site -> (body, position); the potential-field keypoints of the paper, then frames that sensors and controllers use
SITES = {
    "head": ("torso_link", (0.004, 0, 0.474)),
    "left_shoulder": ("left_shoulder_roll_link", (0, 0.005, -0.002)),
    "torso": ("torso_link", (0.006, 0, 0.155)),
    "pelvis": ("pelvis", (0, 0, 0)),
    "left_knee": ("left_knee_link", (0.013, 0, -0.005)),
    "left_foot": ("left_ankle_roll_link", (0.038, 0, -0.020)),
    "left_hand": ("left_wrist_yaw_link", (0.100, -0.015, 0)),
    "left_toe": ("left_ankle_roll_link", (0.130, 0, -0.030)),
    "left_heel": ("left_ankle_roll_link", (-0.055, 0, -0.030)),
    "imu_in_pelvis": ("pelvis", (0.04525, 0, -0.08339)),
    "imu_in_torso": ("torso_link", (-0.03959, -0.00224, 0.14792)),
}

# rotor inertia at the joint [kg m^2], by the end of the joint's name (public motor data)
ARMATURE = {
    "hip_pitch_joint": 0.01018,
    "hip_roll_joint": 0.0251,
    "hip_yaw_joint": 0.01018,
    "knee_joint": 0.0251,
    "ankle_pitch_joint": 0.00722,
    "ankle_roll_joint": 0.00722,
    "waist_yaw_joint": 0.01018,
    "waist_roll_joint": 0.00722,
    "waist_pitch_joint": 0.00722,
    "shoulder_pitch_joint": 0.00361,
    "shoulder_roll_joint": 0.00361,
    "shoulder_yaw_joint": 0.00361,
    "elbow_joint": 0.00361,
    "wrist_roll_joint": 0.00361,
    "wrist_pitch_joint": 0.00425,
    "wrist_yaw_joint": 0.00425,
}
ANKLE_EFFORT = 50.0  # N m: both motors of the parallel ankle, as Unitree's later models state it (URDF: 35)
WAIST_EFFORT = 50.0  # N m: same drive as the ankle


def num(values) -> str:
    return " ".join(f"{v:.10g}" for v in np.atleast_1d(np.asarray(values, float) + 0.0))


def mirrored(rows: dict) -> dict:
    out = dict(rows)
    for name, row in rows.items():
        if name.startswith("left_"):
            out[name.replace("left_", "right_", 1)] = row
    return out


def flip(point, body: str):
    x, y, z = point
    return (x, -y, z) if body.startswith("right_") else (x, y, z)


def geom_lines(body: str) -> list[str]:
    lines = []
    for index, (kind, size, *points) in enumerate(mirrored(GEOMETRY).get(body, ())):
        points = [flip(p, body) for p in points]
        look = "trunk" if body in TRUNK else "foot" if f"{body}_{index}".split("_", 1)[1] in OFF_FLOOR else "body"
        place = f'fromto="{num(points[0] + points[1])}"' if kind == "capsule" else f'pos="{num(points[0])}"'
        lines.append(f'<geom name="{body}_{index}" class="{look}" type="{kind}" size="{num(size)}" {place}/>')
    for part, (owner, radius, points) in (("sole", SOLE), ("palm", PALM)):
        if body.split("_", 1)[-1] == owner.split("_", 1)[-1]:
            side = body.split("_", 1)[0]
            for index, p in enumerate(points):
                lines.append(
                    f'<geom name="{side}_{part}_{index}" class="{part}" size="{num(radius)}" pos="{num(flip(p, body))}"/>'
                )
    return lines


def site_lines(body: str) -> list[str]:
    rows = {}
    for name, (owner, p) in SITES.items():
        rows[name] = (owner, p)
        if name.startswith("left_"):
            rows[name.replace("left", "right", 1)] = (owner.replace("left", "right", 1), p)
    return [f'<site name="{n}" pos="{num(flip(p, o))}"/>' for n, (o, p) in rows.items() if o == body]


def main() -> None:
    import os

    prefix = Path(pin.__file__).parents[4] / "share" / "example-robot-data"
    urdf = Path(os.environ.get("G1_URDF", prefix / "robots" / "g1_description" / "urdf" / "g1_29dof_rev_1_0.urdf"))
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    joints = [n for n in model.names if n.endswith("_joint") and n != "root_joint"]
    body_of = {j: j.replace("_joint", "_link") for j in joints}
    body_of["waist_pitch_joint"] = "torso_link"
    lines: list[str] = []

    def write_body(joint_id: int, depth: int) -> None:
        pad = "  " * depth
        name = "pelvis" if joint_id == 1 else body_of[model.names[joint_id]]
        placement, inertia = model.jointPlacements[joint_id], model.inertias[joint_id]
        if joint_id == 1:
            head = 'pos="0 0 0.79"'
        else:
            quat = pin.Quaternion(placement.rotation).coeffs()[[3, 0, 1, 2]]
            quat = quat * (1 if quat[0] >= 0 else -1)
            head = f'pos="{num(np.where(np.abs(placement.translation) < 1e-15, 0, placement.translation))}"'
            if not np.allclose(placement.rotation, np.eye(3), atol=1e-12):
                head += f' quat="{" ".join(f"{v:.17g}" for v in quat)}"'
        lines.append(f'{pad}<body name="{name}" {head}>')
        m = inertia.inertia
        full = [m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]]
        lines.append(
            f'{pad}  <inertial pos="{num(inertia.lever)}" mass="{inertia.mass:.10g}" fullinertia="{num(full)}"/>'
        )
        if joint_id == 1:
            lines.append(f'{pad}  <freejoint name="floating_base"/>')
        else:
            joint = model.names[joint_id]
            data = model.joints[joint_id]
            axis = {"JointModelRX": "1 0 0", "JointModelRY": "0 1 0", "JointModelRZ": "0 0 1"}[data.shortname()]
            lower, upper = model.lowerPositionLimit[data.idx_q], model.upperPositionLimit[data.idx_q]
            armature = next(v for k, v in ARMATURE.items() if joint.endswith(k))
            lines.append(
                f'{pad}  <joint name="{joint}" axis="{axis}" range="{num([lower, upper])}" armature="{num(armature)}"/>'
            )
        lines.extend(f"{pad}  {line}" for line in geom_lines(name) + site_lines(name))
        for child in range(1, model.njoints):
            if model.parents[child] == joint_id:
                write_body(child, depth + 1)
        lines.append(f"{pad}</body>")

    write_body(1, 2)
    motors = []
    for joint in joints:
        effort = model.upperEffortLimit[model.joints[model.getJointId(joint)].idx_v]
        if "ankle" in joint:
            effort = ANKLE_EFFORT
        if joint in ("waist_roll_joint", "waist_pitch_joint"):
            effort = WAIST_EFFORT
        motors.append(
            f'    <motor name="{joint.removesuffix("_joint")}" joint="{joint}" ctrlrange="{num([-effort, effort])}"/>'
        )
    text = f"""<!-- Unitree G1, 29 joints and a free base, without meshes. Written by tools/derive_g1.py: change that file, not this one.
     Masses, inertias, joint frames and limits: Unitree's published description (BSD-3-Clause, see NOTICE).
     Geometry: primitives that cover every link; soles and palms carry load through four small spheres each.
     Contact bits: 1 floor, 2 carried object, 4 obstacles. Friction is that of the geom of higher priority: palms 2, soles and
     the carried object 1, everything else 0. -->
<mujoco model="g1">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.005" integrator="implicitfast" cone="pyramidal" impratio="30" iterations="10" ls_iterations="20"/>
  <default>
    <joint limited="true"/>
    <motor ctrllimited="true"/>
    <site size="0.01" group="4"/>
    <default class="body"><geom group="2" contype="0" conaffinity="5" condim="3" rgba="0.32 0.35 0.40 1" mass="0"/></default>
    <default class="trunk"><geom group="2" contype="0" conaffinity="7" condim="3" rgba="0.32 0.35 0.40 1" mass="0"/></default>
    <default class="foot"><geom group="2" contype="0" conaffinity="4" condim="3" rgba="0.32 0.35 0.40 1" mass="0"/></default>
    <default class="sole"><geom type="sphere" priority="1" group="3" contype="0" conaffinity="5" condim="3" friction="1 0.005 0.0001" rgba="0.1 0.1 0.1 1" mass="0"/></default>
    <default class="palm"><geom type="sphere" priority="2" solimp="0.95 0.98 0.001" group="3" contype="0" conaffinity="6" condim="3" friction="2 0.005 0.0001" rgba="0.85 0.55 0.2 1" mass="0"/></default>
  </default>
  <worldbody>
{chr(10).join(lines)}
  </worldbody>
  <actuator>
{chr(10).join(motors)}
  </actuator>
</mujoco>
"""
    aside = OUT.with_suffix(".tmp")
    aside.write_text(text)
    aside.replace(OUT)
    print(f"wrote {OUT} ({len(joints)} joints, {sum(i.mass for i in model.inertias):.6f} kg)")


if __name__ == "__main__":
    main()
