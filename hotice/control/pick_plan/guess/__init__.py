"""First guesses of a pick-up's postures, by Gauss-Newton on the kinematics."""
