"""Deployment of a student: messages and links of a Unitree G1. Importing it needs NumPy only; DDS: the extra `deploy`.

Nothing here was ever run on a robot: docs/deploy.md says what that leaves open.
"""
