"""Live pages: a walk (`hotice play --view`), and a run that is trained (`hotice watch`, `hotice train --view`)."""
