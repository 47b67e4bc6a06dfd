"""From the student to a robot: messages and links of a Unitree G1. Importing it costs NumPy only; DDS is the extra `deploy`.

Nothing here was ever run on a robot: docs/deploy.md says what that leaves open.
"""
