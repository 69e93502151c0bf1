"""Fits the gel's two Ogden terms to a silicone's tensile curve; prints what stands in src/constants.rs.

    python3 -m venv venv && venv/bin/pip install numpy scipy
    venv/bin/python checks/ogden_fit.py "Dragon Skin 10 MEDIUM.csv"

The curve: github.com/LucMarechal/Soft-Robotics-Materials-Database, folder Tensile-Tests-Data (open database
licence, not copied here). Its strain is the machine's, so a slack of the clamps is fitted along. A tensile curve
does not tell the second term; it is held at Mooney's exponent, -2. The modulus is not used: the world's is.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

LARGEST_STRAIN = 1.5
SECOND_EXPONENT = -2.0


def nominal_stress(stretch, first, exponent, second):
    """Incompressible bar, MPa; W = sum of mu/alpha (sum of stretch^alpha - 3)."""
    terms = ((first, exponent), (-second, SECOND_EXPONENT))
    return sum(mu * (stretch ** (a - 1) - stretch ** (-a / 2 - 1)) for mu, a in terms)


def main():
    data = np.genfromtxt(sys.argv[1], delimiter=";", skip_header=18)
    strain, stress = data[:, 3], data[:, 4]
    low = strain <= LARGEST_STRAIN
    strain, stress = strain[low], stress[low]

    def off(p):
        return nominal_stress(1 + strain - p[3], *p[:3]) - stress

    weight = 0.002 + 0.02 * stress
    found = least_squares(
        lambda p: off(p) / weight, [0.04, 2.5, 0.005, 0.02], bounds=([0, 0.5, 0, 0], [1, 12, 1, 0.04])
    ).x
    first, exponent, second, slack = found
    parts = np.array([first * exponent, -second * SECOND_EXPONENT])
    print(f"exponents [{exponent:.2f}, {SECOND_EXPONENT:.1f}], shares {np.round(parts / parts.sum(), 2)}")
    print(f"small-strain E {1.5 * parts.sum():.3f} MPa, slack {slack:.3f}")
    print(f"rms {np.sqrt(np.mean(off(found) ** 2)) / stress.max():.4f} of the largest stress")


main()
