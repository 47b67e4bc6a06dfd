"""The task: rules, numbers, presets, perturbations, sensing, scan and history. NumPy and mujoco only."""
