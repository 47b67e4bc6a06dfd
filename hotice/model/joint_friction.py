"""Dry friction of joints that always works against the motion.

MuJoCo treats dry friction as a constraint that asks for the acceleration -B q̇ and may use a torque up to
`frictionloss` for it. Its B is that of a soft contact, about 105/s by default. Where a servo's damping alone brakes
harder, the "friction" pushes the joint on: of moving joints of a G1 in 16 to 19 % of the physics steps, and of the
energy that the written friction takes, 26 to 35 % were missing. With B = 1/h + d/I it asks for what brings the joint to
rest within the step h, given the damping d that the integrator takes implicitly (`implicitfast`) and the inertia I that
the joint feels: Coulomb's law in discrete time.
"""

from __future__ import annotations

import mujoco
import numpy as np


def set_friction_reference(model: mujoco.MjModel) -> None:
    """Sets `dof_solref` of all actuated joints with dry friction, in place; other joints stay as they are.

    Call it last: it reads time step, friction, damping of the servos, and the inverse inertia that `mj_setConst`
    leaves.
    """
    joints = model.jnt_dofadr[model.actuator_trnid[:, 0]]
    # Servos damp by −biasprm[2]; motors have no bias and do not damp.
    damping = np.where(model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE, 0.0, -model.actuator_biasprm[:, 2])
    rate = 1.0 / model.opt.timestep + damping * model.dof_invweight0[joints]
    dry = model.dof_frictionloss[joints] > 0
    dofs = joints[dry]
    model.dof_solref[dofs, 0] = -1.0  # negative: stiffness (friction has none) and damping as such
    # MuJoCo divides this number by dmax, the second of solimp.
    model.dof_solref[dofs, 1] = -rate[dry] * model.dof_solimp[dofs, 1]
