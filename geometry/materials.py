"""Materials in SI with the source of every value, elastic laws and piezoceramics poled along z, and layers of them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.spectra import Rows, Spectrum, Zener

Stiffness = tuple[tuple[float, ...], ...]  # rows of a 6 x 6 matrix
VOIGT = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])  # place of the strain ij in the order xx, yy, zz, yz, xz, xy
FLIPPED = {"x": (4, 5), "y": (3, 5)}  # strains that change sign in a mirror
EXCHANGED = [1, 0, 2, 4, 3, 5]  # strains with x and y exchanged
SAME = 1e-9  # relative to the largest stiffness
ROUNDING = 1e-14  # relative: a stiffness below it is what a turn by a right angle leaves of zero
LAWS = ("young_GPa", "cubic_GPa", "orthotropic", "C_GPa")  # keys of a law in a table of a material
SPECTRA = ("young_GPa_at", "zener")  # keys of an isotropic law that depends on the frequency
PER_LAYER = 8  # elements of a layer whose shear resonance is sought: then to 1e-5 of it
QUADRATIC_STIFFNESS = np.array([[7.0, -8.0, 1.0], [-8.0, 16.0, -8.0], [1.0, -8.0, 7.0]])
QUADRATIC_MASS = np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]])
OTHER_NAMES = {  # trade names and spellings of materials in the library, lower case
    **dict.fromkeys(("plexiglass", "plexiglas", "perspex", "acrylic", "acrylate"), "pmma"),
    **dict.fromkeys(("aluminum", "alu", "al"), "aluminium"),
    **dict.fromkeys(("makrolon", "lexan", "pc"), "polycarbonate"),
    **dict.fromkeys(("gorilla", "gorilla glass", "dragontrail"), "aluminosilicate"),
    **dict.fromkeys(("soda-lime", "soda-lime glass", "float glass"), "glass"),
    **dict.fromkeys(("pyrex", "borofloat"), "borosilicate"),
    **dict.fromkeys(("pdms", "silicone"), "silicone-rubber"),
    **dict.fromkeys(("oca", "adhesive"), "optically-clear-adhesive"),
    **dict.fromkeys(("resin", "sla"), "printing-resin"),
    **dict.fromkeys(("inox", "stainless steel", "stainless"), "steel"),
}
USUAL_C = 20.0  # temperature at which constants hold
GPA = 1e9
VACUUM_F_M = 8.8541878128e-12

# Loss tangents of PZT-4 (0.004), PZT-5A and PZT-5H (0.02) at low field, and their mechanical quality factors (500, 75, 65):
# as makers' tables of the same grades have them.
JAFFE = "H. Jaffe, D. Berlincourt, Piezoelectric transducer materials, Proc. IEEE 53 (1965) 1372-1386"

FERROPERM = (
    "Ferroperm Pz26 data sheet (full material data set); k31 0.33, k33 0.68, kp 0.57, kt 0.47 there too; "
    "loss tangent and mechanical quality factor are those of its kind (hard, 0.002 to 0.005 and about 1000 in makers' "
    "tables), not read from its own sheet"
)


@dataclass(frozen=True)
class Isotropic:
    """The two constants of an isotropic law."""

    young_pa: float
    poisson: float

    @property
    def shear_pa(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)), Pa."""
        return self.young_pa / (2.0 * (1.0 + self.poisson))

    @property
    def lame_pa(self) -> float:
        """First Lame constant lambda = E nu / ((1 + nu)(1 - 2 nu)), Pa."""
        return self.young_pa * self.poisson / ((1.0 + self.poisson) * (1.0 - 2.0 * self.poisson))


class Rod(NamedTuple):
    """A rod cut along an axis: Young's modulus, Poisson's ratio and shear modulus, the last two averaged over the section."""

    young_pa: float
    poisson: float
    shear_pa: float


@dataclass(frozen=True)
class Material:
    """A linear elastic law with its density, axes along x, y, z.

    stiffness_pa: over the strains xx, yy, zz, yz, xz, xy (engineering shear). constants: those of an isotropic law, which
    `isotropic` makes; None for any other. loss_factor, softening_per_k (of all stiffnesses alike, relative to 20 C) and
    expansion_per_k: None where they are not known. spectrum: Young's modulus at 20 C and loss factor of a law that depends on
    the frequency; it is then the law at taken_hz. Raises GeometryError unless the density and all eigenvalues are above 0.
    """

    name: str
    density_kg_m3: float
    stiffness_pa: Stiffness
    constants: Isotropic | None = None
    source: str = "given in the case file"
    loss_factor: float | None = None
    softening_per_k: float | None = None
    expansion_per_k: float | None = None
    temperature_c: float = USUAL_C
    spectrum: Spectrum | None = None
    taken_hz: float | None = None

    def __post_init__(self) -> None:
        c = np.array(self.stiffness_pa)
        if not (self.density_kg_m3 > 0.0 and (c == c.T).all() and np.linalg.eigvalsh(c)[0] > 0.0):
            raise GeometryError(f"material {self.name}: the density, and the energy of any strain, must be above 0")

    @classmethod
    def isotropic(
        cls, name: str, young_pa: float, density_kg_m3: float, poisson: float, source: str = "given in the case file"
    ) -> Material:
        """An isotropic solid. GeometryError unless E and density are above 0, nu between -1 and 0.5 with both excluded (a
        displacement element cannot hold the volume).
        """
        if not (young_pa > 0.0 and density_kg_m3 > 0.0 and -1.0 < poisson < 0.5):
            raise GeometryError(
                f"material {name}: E = {young_pa:g} Pa, density = {density_kg_m3:g} kg/m3, "
                f"nu = {poisson:g}: E and density must be above 0, nu between -1 and 0.5, both excluded"
            )
        own = Isotropic(young_pa, poisson)
        stiffness = own.shear_pa * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
        stiffness[:3, :3] += own.lame_pa
        return cls(name, density_kg_m3, _rows_of(stiffness), own, source)

    @classmethod
    def anisotropic(cls, name: str, stiffness_pa: FloatArray, density_kg_m3: float, source: str) -> Material:
        """A law of up to 21 constants: stiffness (6, 6) in Pa over xx, yy, zz, yz, xz, xy."""
        return cls(name, density_kg_m3, _rows_of((stiffness_pa + stiffness_pa.T) / 2.0), None, source)

    @classmethod
    def of_table(cls, name: str, table: Mapping[str, Any]) -> Material:
        """A material by the keys of a case file. GeometryError with the key of a constant that no solid can have."""
        density, source = float(table["density_kg_m3"]), table.get("source", "given in the case file")
        if spectrum := _spectrum(table):
            young, _ = spectrum.at(spectrum.middle_hz)
            own = cls.isotropic(name, young, density, float(table["poisson"]), source)
            return replace(own, **_known(table), spectrum=spectrum).at_hz(spectrum.middle_hz)
        if table.get("young_GPa") is not None:
            own = cls.isotropic(name, GPA * table["young_GPa"], density, float(table["poisson"]), source)
        else:
            key = next(key for key in LAWS if table.get(key) is not None)
            law: Any = table[key]
            made: dict[str, Callable[[Any], FloatArray]] = {
                "cubic_GPa": _cubic,
                "orthotropic": _orthotropic,
                "C_GPa": _of_21,
            }
            stiffness = made[key](law)
            own = cls.anisotropic(name, GPA * stiffness, density, source).turned(table.get("axes_deg"))
        return replace(own, **_known(table))

    def turned(self, axes_deg: tuple[float, float, float] | None) -> Material:
        """Return the law with its own axes turned by Bunge's angles: about z, about the new x, about the new z, deg.

        C'_ijkl = R_ia R_jb R_kc R_ld C_abcd, R = Rz(phi) Rx(theta) Rz(psi). An isotropic law stays what it is.
        """
        if self.constants or not axes_deg or not any(axes_deg):
            return self
        phi, theta, psi = np.deg2rad(axes_deg)
        turn = _about(2, phi) @ _about(0, theta) @ _about(2, psi)
        tensor = np.einsum("ia,jb,kc,ld,abcd->ijkl", *4 * [turn], self.tensor_pa, optimize=True)
        c = tensor[PAIRS[:, 0], PAIRS[:, 1]][:, PAIRS[:, 0], PAIRS[:, 1]]
        c = np.where(np.abs(c) > ROUNDING * np.abs(c).max(), (c + c.T) / 2.0, 0.0)
        return replace(self, stiffness_pa=_rows_of(c))

    def at(self, temperature_c: float) -> Material:
        """Return the law, known at 20 C, at a temperature in C."""
        factor = self.warm(temperature_c)
        return replace(self.scaled(factor) if factor != 1.0 else self, temperature_c=temperature_c)

    def warm(self, temperature_c: float) -> float:
        """Return its stiffness at a temperature in C over that at 20 C; a coefficient that is not known counts as 0.

        A body whose edges grow by s has 1/s of the slopes, s^3 of the volume and the same mass: on the nodes of the cold body
        its stiffness is s times that of the constants, its mass is the same.
        """
        warmer = temperature_c - USUAL_C
        stiffness, edges = (1.0 + (each or 0.0) * warmer for each in (self.softening_per_k, self.expansion_per_k))
        if min(stiffness, edges) <= 0.0:
            raise GeometryError(f"material {self.name}: no stiffness is left at {temperature_c:g} C")
        return stiffness * edges

    def at_hz(self, frequency_hz: float) -> Material:
        """Return the law at a frequency in Hz; itself where it does not depend on it."""
        if not self.spectrum:
            return self
        young, loss = self.spectrum.at(frequency_hz)
        before = self.spectrum.at(self.taken_hz or self.spectrum.middle_hz)[0]
        return replace(self.scaled(young / before), loss_factor=loss, taken_hz=frequency_hz)

    def stiffening(self, frequency_hz: float) -> float:
        """Return its modulus at a frequency in Hz over that of the law as it is, dimensionless."""
        if not self.spectrum or not self.taken_hz:
            return 1.0
        return self.spectrum.at(frequency_hz)[0] / self.spectrum.at(self.taken_hz)[0]

    def scaled(self, factor: float) -> Material:
        """Return the law with its stiffness multiplied by `factor`."""
        stiffness = _rows_of(factor * np.array(self.stiffness_pa))
        own = self.constants and replace(self.constants, young_pa=factor * self.constants.young_pa)
        return replace(self, stiffness_pa=stiffness, constants=own)

    @property
    def lost(self) -> float:
        """Its loss factor. GeometryError where it is not known."""
        if self.loss_factor is None:
            raise GeometryError(f"material {self.name}: its loss factor is not known")
        return self.loss_factor

    @property
    def as_isotropic(self) -> Isotropic:
        """Its constants, for theories that hold for isotropic laws alone. GeometryError for any other law."""
        if self.constants is None:
            raise GeometryError(f"material {self.name}: must be isotropic: singular edges and exact waves require it")
        return self.constants

    @cached_property
    def average(self) -> Isotropic:
        """The isotropic law nearest to it (Voigt's average), itself where it is isotropic: for estimates."""
        if self.constants:
            return self.constants
        c = np.array(self.stiffness_pa)
        normal, coupled, shear = np.trace(c[:3, :3]), c[0, 1] + c[0, 2] + c[1, 2], np.trace(c[3:, 3:])
        bulk, rigid = (normal + 2.0 * coupled) / 9.0, (normal - coupled + 3.0 * shear) / 15.0
        young = 9.0 * bulk * rigid / (3.0 * bulk + rigid)
        return Isotropic(float(young), float(young / (2.0 * rigid) - 1.0))

    @property
    def stated(self) -> dict[str, object]:
        """Name, constants and density, as records have them, and what else is known of it."""
        law = vars(self.constants) if self.constants else {"stiffness_pa": self.stiffness_pa}
        more = {key: getattr(self, key) for key in ("loss_factor", "softening_per_k", "expansion_per_k")}
        known = {key: value for key, value in more.items() if value is not None}
        if self.temperature_c != USUAL_C:
            known["temperature_c"] = self.temperature_c
        if self.spectrum:
            known |= {"spectrum": astuple(self.spectrum), "taken_hz": self.taken_hz}
        return {"name": self.name, **law, "density_kg_m3": self.density_kg_m3, **known}

    @property
    def shear_m_s(self) -> float:
        """Speed of shear waves, sqrt(G/rho), m/s; the slowest along an axis where directions differ."""
        return sqrt(min(self.stiffness_pa[place][place] for place in (3, 4, 5)) / self.density_kg_m3)

    @property
    def pressure_m_s(self) -> float:
        """Speed of pressure waves, sqrt((lambda + 2 G)/rho), m/s; of its average where directions differ."""
        return sqrt((self.average.lame_pa + 2.0 * self.average.shear_pa) / self.density_kg_m3)

    @cached_property
    def tensor_pa(self) -> FloatArray:
        """Stiffness tensor C_ikjl, shape (3, 3, 3, 3), Pa."""
        return np.asarray(np.array(self.stiffness_pa)[VOIGT[:, :, None, None], VOIGT])

    @cached_property
    def compliance_pa(self) -> FloatArray:
        """Inverse of the stiffness, shape (6, 6), 1/Pa."""
        return np.asarray(np.linalg.inv(np.array(self.stiffness_pa)))

    @cached_property
    def plane_stress_pa(self) -> FloatArray:
        """Plane-stress stiffness over xx, yy, xy, which governs bending, shape (3, 3), Pa."""
        flat = [0, 1, 5]
        return np.asarray(np.linalg.inv(self.compliance_pa[np.ix_(flat, flat)]))

    @property
    def transverse_shear_pa(self) -> tuple[float, float]:
        """Shear moduli through a plate, xz and yz, Pa."""
        return 1.0 / float(self.compliance_pa[4, 4]), 1.0 / float(self.compliance_pa[3, 3])

    def rod(self, axis: int) -> Rod:
        """Elastic constants of a rod along an axis, 0 to 2."""
        s, others = self.compliance_pa, [other for other in range(3) if other != axis]
        poisson = -sum(s[axis, other] for other in others) / (2.0 * s[axis, axis])
        shear = 2.0 / sum(s[place, place] for place in VOIGT[axis, others])
        return Rod(1.0 / float(s[axis, axis]), float(poisson), float(shear))

    @cached_property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors that leave it alone: x, y, and "d", which exchanges x and y."""
        c, images = np.array(self.stiffness_pa), {"d": np.array(self.stiffness_pa)[np.ix_(EXCHANGED, EXCHANGED)]}
        for name, places in FLIPPED.items():
            sign = np.where(np.isin(np.arange(6), places), -1.0, 1.0)
            images[name] = c * np.outer(sign, sign)
        return tuple(name for name in ("x", "y", "d") if np.abs(images[name] - c).max() <= SAME * np.abs(c).max())


PAIRS = np.array([[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]])  # of the strains xx, yy, zz, yz, xz, xy


def _about(axis: int, angle: float) -> FloatArray:
    """Rotation by an angle about a coordinate axis, (3, 3)."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[one, one] = turn[other, other] = np.cos(angle)
    turn[one, other], turn[other, one] = -np.sin(angle), np.sin(angle)
    return turn


def _cubic(law: Mapping[str, float]) -> FloatArray:
    """Stiffness of a cubic law along its axes, (6, 6)."""
    c11, c12, c44 = (float(law[key]) for key in ("C11", "C12", "C44"))  # a file may have whole numbers
    if not (c44 > 0.0 and c11 > abs(c12) and c11 + 2.0 * c12 > 0.0):
        raise GeometryError("cubic_GPa: C44 must be above 0, C12 between -C11/2 and C11, both excluded")
    c = np.diag([c11] * 3 + [c44] * 3)
    c[:3, :3] += c12 * (1.0 - np.eye(3))
    return c


def _orthotropic(law: Mapping[str, float]) -> FloatArray:
    """Stiffness of an orthotropic law along its axes, (6, 6), from nine constants; nu12 = -e2/e1 under s1 alone."""
    young = [law[f"E{i}_GPa"] for i in (1, 2, 3)]
    s = np.diag([1.0 / each for each in (*young, *(law[f"G{pair}_GPa"] for pair in ("23", "13", "12")))])
    for i, j in ((0, 1), (0, 2), (1, 2)):
        ratio, most = law[f"nu{i + 1}{j + 1}"], sqrt(young[i] / young[j])
        if abs(ratio) >= most:
            raise GeometryError(f"orthotropic.nu{i + 1}{j + 1}: must be below sqrt(E{i + 1}/E{j + 1}) = {most:.4g}")
        s[i, j] = s[j, i] = -ratio / young[i]
    if np.linalg.eigvalsh(s)[0] <= 0.0:
        raise GeometryError(
            "orthotropic: nu12, nu13 and nu23 together leave a strain without energy: lower one of them"
        )
    return np.asarray(np.linalg.inv(s))


def _of_21(rows: list[list[float]]) -> FloatArray:
    """Stiffness of any law, (6, 6)."""
    c = np.array(rows, dtype=float)
    for i, j in np.argwhere(np.triu(np.abs(c - c.T) > SAME * np.abs(c).max())).tolist():
        raise GeometryError(f"C_GPa: row {i + 1}, column {j + 1} must equal row {j + 1}, column {i + 1}")
    least = float(np.linalg.eigvalsh((c + c.T) / 2.0)[0])
    if least <= 0.0:
        raise GeometryError(f"C_GPa: must be positive definite; its smallest eigenvalue is {least:.3g} GPa")
    return c


def _spectrum(table: Mapping[str, Any]) -> Spectrum | None:
    """The modulus over frequency of a table, None if it gives none."""
    rows, zener = (table.get(key) for key in SPECTRA)
    if zener:
        return Zener(GPA * zener["relaxed_GPa"], GPA * zener["unrelaxed_GPa"], zener["time_s"], zener["order"])
    return Rows(tuple((float(hz), GPA * young, float(loss)) for hz, young, loss in rows)) if rows else None


def _known(table: Mapping[str, Any]) -> dict[str, Any]:
    """What a table of a material states of it next to its law and density, by the fields of a material."""
    keys = {"loss_factor": "loss_factor", "dE_dT_per_K": "softening_per_k", "expansion_per_K": "expansion_per_k"}
    return {field: table[key] for key, field in keys.items() if table.get(key) is not None}


def _rows_of(matrix: FloatArray) -> Stiffness:
    """A matrix (6, 6) as a value that can be compared and hashed."""
    return tuple(map(tuple, matrix.tolist()))


LIBRARY: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
NAMED_LAWS = dict(zip(LAWS, ("isotropic", "cubic", "orthotropic", "anisotropic"), strict=True))
MATERIALS: dict[str, Material] = {name: Material.of_table(name, table) for name, table in LIBRARY.items()}


def law_of(name: str) -> str:
    """Name the law of a material of the library.

    Parameters
    ----------
    name : str
        Name of the material.

    Returns
    -------
    str
        isotropic, cubic, orthotropic or anisotropic.
    """
    return next(word for key, word in NAMED_LAWS.items() if key in LIBRARY[name])


@dataclass(frozen=True)
class PiezoMaterial:
    """A ceramic of class 6mm, poled along z; strain order xx, yy, zz, yz, xz, xy (engineering shear).

    compliance_*: s^E in 1/Pa; d_* in C/N (= m/V); relative_*_free: eps^T/eps0 without unit; c66 follows from
    s66 = 2 (s11 - s12). Stress form: e = d c^E, eps^S = eps^T - d c^E d'. Source: ieee176.
    """

    name: str
    density_kg_m3: float
    s11: float
    s12: float
    s13: float
    s33: float
    s44: float
    d31: float
    d33: float
    d15: float
    relative_11_free: float
    relative_33_free: float
    source: str
    loss_tangent: float | None = None  # of the dielectric at low field; None where it is not known
    loss_factor: float | None = None  # of the stiffness, 1/Qm; None where it is not known

    @property
    def compliance_pa(self) -> FloatArray:
        """s^E, shape (6, 6), 1/Pa."""
        s = np.zeros((6, 6))
        s[:3, :3] = [
            [self.s11, self.s12, self.s13],
            [self.s12, self.s11, self.s13],
            [self.s13, self.s13, self.s33],
        ]
        s[3, 3] = s[4, 4] = self.s44
        s[5, 5] = 2.0 * (self.s11 - self.s12)
        return s

    @property
    def stiffness_pa(self) -> FloatArray:
        """c^E, stiffness at constant field, shape (6, 6), Pa."""
        return np.asarray(np.linalg.inv(self.compliance_pa))

    @property
    def charge_m_v(self) -> FloatArray:
        """d, strain per field, shape (3, 6), m/V."""
        d = np.zeros((3, 6))
        d[2, :3] = self.d31, self.d31, self.d33
        d[1, 3] = d[0, 4] = self.d15
        return d

    @property
    def stress_c_m2(self) -> FloatArray:
        """e = d c^E, stress per field, shape (3, 6), C/m2."""
        return self.charge_m_v @ self.stiffness_pa

    @property
    def permittivity_free_f_m(self) -> FloatArray:
        """eps^T at constant stress, shape (3, 3), F/m."""
        return VACUUM_F_M * np.diag([self.relative_11_free, self.relative_11_free, self.relative_33_free])

    @property
    def permittivity_clamped_f_m(self) -> FloatArray:
        """eps^S = eps^T - d c^E d' at constant strain, shape (3, 3), F/m."""
        return self.permittivity_free_f_m - self.charge_m_v @ self.stress_c_m2.T

    @property
    def thin_young_pa(self) -> float:
        """Young's modulus along the patch, 1/s11, Pa."""
        return 1.0 / self.s11


PIEZO_MATERIALS: dict[str, PiezoMaterial] = {
    material.name: material
    for material in (
        PiezoMaterial(
            "pz26", 7700.0, 13.0e-12, -4.35e-12, -7.05e-12, 19.6e-12, 33.2e-12,
            -128e-12, 328e-12, 327e-12, 1190.0, 1330.0, FERROPERM, 3e-3, 1e-3,
        ),
        PiezoMaterial(
            "pzt-4", 7500.0, 12.3e-12, -4.05e-12, -5.31e-12, 15.5e-12, 39.0e-12,
            -123e-12, 289e-12, 496e-12, 1475.0, 1300.0, JAFFE, 4e-3, 1 / 500,
        ),
        PiezoMaterial(
            "pzt-5a", 7750.0, 16.4e-12, -5.74e-12, -7.22e-12, 18.8e-12, 47.5e-12,
            -171e-12, 374e-12, 584e-12, 1730.0, 1700.0, JAFFE, 2e-2, 1 / 75,
        ),
        PiezoMaterial(
            "pzt-5h", 7500.0, 16.5e-12, -4.78e-12, -8.45e-12, 20.7e-12, 43.5e-12,
            -274e-12, 593e-12, 741e-12, 3130.0, 3400.0, JAFFE, 2e-2, 1 / 65,
        ),
    )
}  # fmt: skip


def layer_names(count: int) -> tuple[str, ...]:
    """Name the regions of a mesh for the layers of a plate.

    Parameters
    ----------
    count : int
        Number of layers.

    Returns
    -------
    tuple of str
        From the touch face: plate, then layer2 and so on.
    """
    return ("plate", *(f"layer{number}" for number in range(2, count + 1)))


class Layer(NamedTuple):
    """One layer of the plate."""

    material: Material
    thickness_m: float


class Warming(NamedTuple):
    """What one kelvin does to a free plate: mid-plane strains (3,) 1/K, curvatures (3,) 1/(m K), both over xx, yy, 2 xy, and
    the stresses xx, yy, xy at each layer's two faces, (layers, 2, 3), Pa/K.
    """

    strain: FloatArray
    curvature_per_m: FloatArray
    stress_pa: FloatArray


@dataclass(frozen=True)
class Stack:
    """Layers bonded to one another, from the touch face z = 0 to the back."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, thickness_m: float, material: Material) -> Stack:
        """A plate of one layer."""
        return cls((Layer(material, thickness_m),))

    @classmethod
    def of_layers(cls, layers: Iterable[Layer]) -> Stack:
        """A plate of several layers; neighbours of one material are one layer."""
        merged: list[Layer] = []
        for layer in layers:
            if merged and merged[-1].material == layer.material:
                merged[-1] = Layer(layer.material, merged[-1].thickness_m + layer.thickness_m)
            else:
                merged.append(layer)
        return cls(tuple(merged))

    @property
    def thickness_m(self) -> float:
        """Thickness of all layers, m."""
        return sum(thickness for _, thickness in self.layers)

    @property
    def levels_m(self) -> FloatArray:
        """Heights where layers begin and end, ascending from 0, (layers + 1,), m."""
        return np.cumsum([0.0, *(thickness for _, thickness in self.layers)])

    @property
    def joints_m(self) -> tuple[float, ...]:
        """Heights where two layers meet, ascending, m."""
        return tuple(self.levels_m[1:-1].tolist())

    @property
    def joints(self) -> tuple[float, ...]:
        """Where two layers meet, from -1 on the touch face to 1 on the back."""
        return tuple(2.0 * level / self.thickness_m - 1.0 for level in self.joints_m)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Region of a mesh for each layer, from the touch face."""
        return layer_names(len(self.layers))

    @property
    def mass_kg_m2(self) -> float:
        """Mass per area, kg/m2."""
        return sum(material.density_kg_m3 * thickness for material, thickness in self.layers)

    @property
    def regions(self) -> dict[str, Material]:
        """Material of each layer by its region of a mesh: plate, then layer2 and so on."""
        return {name: material for name, (material, _) in zip(self.region_names, self.layers, strict=True)}

    @property
    def is_uniform(self) -> bool:
        """Whether the plate is one layer of an isotropic law, of which plates were calibrated."""
        return len(self.layers) == 1 and self.back.constants is not None

    @property
    def back(self) -> Material:
        """Material of the back, on which pillars stand."""
        return self.layers[-1].material

    @property
    def touch(self) -> Material:
        """Material of the touch face."""
        return self.layers[0].material

    @property
    def material(self) -> Material:
        """Its only material, for what holds for one layer alone. GeometryError for several layers."""
        if len(self.layers) > 1:
            raise GeometryError(f"a plate of {len(self.layers)} layers: this computation needs a single layer")
        return self.back

    @cached_property
    def mean(self) -> Material:
        """The material with its mean density and stiffness, its own where it has one layer: for estimates and as a unit."""
        if len(self.layers) == 1:
            return self.back
        parts = [part / self.thickness_m * np.array(material.stiffness_pa) for material, part in self.layers]
        law = Material("mean", self.mass_kg_m2 / self.thickness_m, _rows_of(np.sum(parts, axis=0)))
        return replace(law, constants=law.average) if all(material.constants for material, _ in self.layers) else law

    @cached_property
    def shear_cutoff_hz(self) -> float:
        """First thickness-shear resonance between free faces, Hz: c_t / (2 h) of one layer, the slower of xz and yz of several.

        -(G u')' = omega^2 rho u through the layers, each by PER_LAYER quadratic elements.
        """
        if len(self.layers) == 1:
            return self.back.shear_m_s / (2.0 * self.thickness_m)
        return min(self._shear_hz(place) for place in (3, 4))

    def _shear_hz(self, place: int) -> float:
        count, unit = 2 * PER_LAYER * len(self.layers) + 1, self.mean
        scale = unit.average.shear_pa
        stiffness, mass = np.zeros((count, count)), np.zeros((count, count))
        for number, (material, thickness) in enumerate(self.layers):
            size = thickness / PER_LAYER / self.thickness_m
            for first in range(2 * PER_LAYER * number, 2 * PER_LAYER * (number + 1), 2):
                own = np.ix_(range(first, first + 3), range(first, first + 3))
                stiffness[own] += material.stiffness_pa[place][place] / scale / (3.0 * size) * QUADRATIC_STIFFNESS
                mass[own] += material.density_kg_m3 / unit.density_kg_m3 * size / 30.0 * QUADRATIC_MASS
        root = np.linalg.cholesky(mass)
        half = np.linalg.solve(root, stiffness)
        second = np.linalg.eigvalsh(np.linalg.solve(root, half.T))[1]
        return float(sqrt(second * scale / unit.density_kg_m3) / (2.0 * pi * self.thickness_m))

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors that leave every layer alone: x, y, and "d", which exchanges x and y."""
        return tuple(name for name in ("x", "y", "d") if all(name in material.mirrors for material, _ in self.layers))

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """int (1, z, z^2) dz about the middle, of the plane stiffness, (3, 3, 3), and of the density, (3,)."""
        z = self.levels_m - self.thickness_m / 2.0
        powers = np.array([np.diff(z**n) / n for n in (1, 2, 3)])
        planes = np.array([material.plane_stress_pa for material, _ in self.layers])
        return np.einsum("nl,lij->nij", powers, planes), powers @ [
            material.density_kg_m3 for material, _ in self.layers
        ]

    @cached_property
    def bending_n_m(self) -> FloatArray:
        """Bending stiffnesses over the curvatures xx, yy, 2 xy with no force in the plane, D - B A^-1 B, (3, 3), N m."""
        a, b, d = self._moments[0]
        return np.asarray(d - b @ np.linalg.solve(a, b))

    @cached_property
    def warming(self) -> Warming | None:
        """Free expansion by laminate theory, far from edges; None where the expansion of a layer is not known.

        s(z) = Q(z) (e + z k - a(z)) with int s dz = 0 and int s z dz = 0; its only layer expands without stress.
        """
        known = [material.expansion_per_k for material, _ in self.layers]
        if any(each is None for each in known):
            return None
        free = np.outer(np.array(known, dtype=float), [1.0, 1.0, 0.0])
        planes = np.array([material.plane_stress_pa for material, _ in self.layers])
        z = self.levels_m - self.thickness_m / 2.0
        force, moment = (np.einsum("l,lij,lj->i", np.diff(z**n) / n, planes, free) for n in (1, 2))
        a, b, d = self._moments[0]
        size = self.thickness_m  # forces and moments, strains and curvatures in like units
        whole = np.block([[a, b / size], [b / size, d / size**2]])
        strain, curvature = np.split(np.linalg.solve(whole, np.concatenate([force, moment / size])), 2)
        curvature = curvature / size
        faces = np.stack([z[:-1], z[1:]], axis=1)
        own = strain + faces[:, :, None] * curvature - free[:, None, :]
        return Warming(strain, curvature, np.einsum("lij,lfj->lfi", planes, own))

    @property
    def is_stressed(self) -> bool:
        """Whether its layers, free to expand together, hold one another at their temperature."""
        return len(self.layers) > 1 and self.back.temperature_c != USUAL_C and self.warming is not None

    @property
    def rotary_kg(self) -> float:
        """Rotary inertia per area about the centre of mass, kg: rho h^3/12 of one layer."""
        first, middle, square = self._moments[1]
        return float(square - middle**2 / first)

    @property
    def shear_n_m(self) -> tuple[float, float]:
        """Transverse shear stiffnesses along x and y, N/m: 5/6 G h of one layer, of several with the mean of 1/G."""
        soft = [thickness / np.array(material.transverse_shear_pa) for material, thickness in self.layers]
        along, across = (5.0 / 6.0 * self.thickness_m**2 / np.sum(soft, axis=0)).tolist()
        return along, across
