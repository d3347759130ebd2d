"""What energies take for a number."""

from yasps import Attribute

Scalar = Attribute | float
