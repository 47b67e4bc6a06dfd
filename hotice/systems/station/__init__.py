"""The station: one Drake diagram of plant, sensors, fields, controllers and safety monitor."""
