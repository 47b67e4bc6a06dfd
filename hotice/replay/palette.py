"""Colours, camera and sky of everything that shows rollouts; `viewer.js`, `viewer.css` and `steer.js` repeat them."""

from __future__ import annotations

INK, SKY, FLOOR, TILE_LINES = "#1d2733", "#eef2f6", "#c9d1da", "#b4bfcb"
CATEGORY_COLORS = {"ground": "#b4533c", "side": "#5f7590", "overhead": "#7a5aa6"}
OTHER_COLOR = "#7c8da3"
"""Of an obstacle of no category that is known."""
SGF_COLOR, OGF_COLOR, GOAL_COLOR, ROOT_COLOR, OBJECT_COLOR = "#1f6fe5", "#e8710a", "#16a34a", "#334155", "#c2410c"
OUTCOME_COLORS = {"success": "#15803d", "timeout": "#a16207", "running": "#a16207"}
FAILURE_COLOR = "#b91c1c"

FIELD_OF_VIEW_DEG = 40.0
FROM = (0.42, -0.83, 0.36)
"""Direction from what is looked at to the camera that goes with the robot, W."""
FAR_M, AHEAD_M, HEIGHT_M = 3.6, 0.35, 0.68
"""Distance of that camera; and where it looks: before the pelvis and over the floor [m]."""
HAZE_M = (9.0, 26.0)
"""Distance from the camera where things begin to fade into the sky, and where nothing else is seen [m]."""
TILE_M = 0.5
"""Distance of the lines on the floor [m]."""
