"""Answers that do not come from flexlab: stored solutions, Pinocchio's arms, energies by quadrature."""
