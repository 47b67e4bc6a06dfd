"""The proprioceptive history: what a policy may also read of the control steps before.

One instant does not show how late measurements and motors are, how strong the motors, how heavy the object or how fast
the robot moves over the floor; a few of them do. Torch-free: training and deployment keep the same numbers.
"""

from __future__ import annotations

from hotice.checks import Range

ROWS = (("gyro", 3), ("gravity", 3), ("joint_pos", 20), ("joint_vel", 20), ("last_action", 20))
"""Rows of the observation that are kept, and their widths: a frame."""
FRAME = sum(width for _, width in ROWS)
"""Numbers of a frame, one control step."""
LONGEST = 50
"""Most control steps that can be kept: one second."""
LENGTHS = Range(least=0, most=LONGEST)
