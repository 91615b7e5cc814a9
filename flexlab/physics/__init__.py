"""The plant: beam, arms, their coupled equations of motion, energies and forces."""
