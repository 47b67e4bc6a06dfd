"""Senses of a simulated robot: what its encoders, IMU, battery, localization and head camera say."""
