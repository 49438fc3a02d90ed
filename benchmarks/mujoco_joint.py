"""The joint as a MuJoCo model, the peer of the twin's mechanics.

The same bodies: a head that turns on a torsion spring and sinks on an axial spring, four spatial tendons of locked
length, and a lever on the head that a motor with the drive's torque line swings. MuJoCo has no Prony series and no
tension-dependent presliding friction; dampers stand in for them, so it has less to compute than the twin.
"""

import math

from sinew.plan.plan import Group
from sinew.plan.rig import RigSpec
from sinew.twin.simulate import lane_parameters, rest_tension


def joint_xml(rig: RigSpec, pretension_mm: float, *, step_s: float = 0.00125, axial: bool = True) -> str:
    """Return the MJCF of the joint at a pretension [mm]; z is the axis of the continuum.

    axial: False keeps the head at its height at rest, for a comparison of the tendons' torque alone.
    """
    lanes, shortening = lane_parameters([Group("idle", pretension_mm, math.nan, math.nan, 0, 0.0, 1.0)], rig)
    height = float(lanes.free_span[0] - shortening[0])
    cable_end = float(lanes.cable_end[0])
    stretch = 1 - float(shortening[0] / lanes.length[0])
    torsional = float(lanes.torsional_rigidity[0] / (lanes.length[0] * stretch))
    axial_stiffness = 3 * float(lanes.axial_rigidity[0] / lanes.length[0])
    pull = len(lanes.guide_directions) * float(rest_tension([pretension_mm], rig)[0])
    base, head = float(lanes.base_radius[0]), float(lanes.head_radius[0])
    directions = [(float(c[0]), float(s[0])) for c, s in lanes.guide_directions]
    sites = [
        "".join(f'<site name="{name}{i}" pos="{r * c} {r * s} 0"/>' for i, (c, s) in enumerate(directions))
        for name, r in (("base", base), ("head", head))
    ]
    spatial = "".join(
        f'<spatial stiffness="{float(lanes.stiffness[0])}" springlength="0 {cable_end}">'
        f'<site site="base{i}"/><site site="head{i}"/></spatial>'
        for i in range(len(directions))
    )
    slide = (
        f'<joint name="sink" type="slide" axis="0 0 1" stiffness="{axial_stiffness}"'
        f' springref="{pull / axial_stiffness}" damping="20"/>'
        if axial
        else ""
    )
    inertia = f'<inertial pos="0 0 0" mass="{float(lanes.head_mass[0]) / 2}" diaginertia="1e-2 1e-2 '
    lever = float(lanes.lever[0])
    gain = float(lanes.position_gain[0] * lanes.duty_torque[0])
    limit = float(lanes.duty_torque[0])
    return f"""<mujoco><option timestep="{step_s}" integrator="implicitfast" gravity="0 0 0">
    <flag contact="disable" constraint="disable"/></option><worldbody>{sites[0]}<body name="head" pos="0 0 {height}">
    {slide}<joint name="torsion" type="hinge" axis="0 0 1" stiffness="{torsional}" damping="0.02"/>
    {inertia}{float(lanes.head[0])}"/>{sites[1]}
    <body name="lever"><joint name="drive" type="hinge" axis="0 0 1" armature="{float(lanes.armature[0])}"
    damping="{float(lanes.speed_slope[0])}"/>{inertia}{lever}"/></body></body></worldbody>
    <tendon>{spatial}</tendon><actuator><position joint="drive" kp="{gain}" forcerange="{-limit} {limit}"/></actuator>
    </mujoco>"""
