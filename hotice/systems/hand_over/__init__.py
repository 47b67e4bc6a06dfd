"""The hand-over from pick-up to carrying: rehearsals of what would carry on, and the switch between controllers."""
