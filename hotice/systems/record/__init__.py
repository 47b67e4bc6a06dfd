"""Records of a station: logs, rollouts, pictures, hand-over reports."""
