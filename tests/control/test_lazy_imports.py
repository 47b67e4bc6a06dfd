"""Importing the package costs neither Pinocchio nor Drake nor a solver."""

import subprocess
import sys


def test_heavy_packages_are_imported_where_they_are_used():
    code = (
        "import sys, hotice.control, hotice.control.controller\n"
        "heavy = {'pinocchio', 'pydrake', 'casadi', 'proxsuite', 'osqp', 'mujoco', 'torch'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
