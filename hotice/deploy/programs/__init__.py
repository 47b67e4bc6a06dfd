"""Programs of a deployment: guard and runner, each a process of its own, started by `hotice deploy`."""
