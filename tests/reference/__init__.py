"""Reference results that flexlab did not compute: stored solutions, Pinocchio's arms, energies by quadrature."""
