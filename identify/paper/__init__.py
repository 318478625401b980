"""The paper's closed form (Eqs. 22-33)."""
