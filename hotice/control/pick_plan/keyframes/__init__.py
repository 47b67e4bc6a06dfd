"""Keyframes of a pick-up, by Drake's inverse kinematics."""
