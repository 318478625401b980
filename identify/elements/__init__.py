"""Force elements between body, wheel and road: each with its force and its derivatives in one file.

Every function takes scalars or arrays and is free of branches, so that the same formula is the
NumPy reference and, compiled by Numba where it is installed, the fast path.  Displacements and
speeds of a suspension are positive in compression, forces act upwards on the body.
"""
