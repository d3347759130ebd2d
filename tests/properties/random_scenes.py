"""Random scenes, written as the Python program that a user would type: what fails can be read and run as it stands.

Every primitive or union of a scene that others build on (a `Layer`) has an attribute "x" of d numbers: stored, computed
from parameters, from a JOIN of another layer, or a UNION of layers. Energies read layers directly or through JOINs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st
from scene_formulas import energies, kinked_mixtures, kinked_points

from yasps import Scene

PREAMBLE = """\
import numpy as np
from yasps import Scene, atan2, concat_cols, concat_rows, maximum, minimum, select
rng = np.random.default_rng({seed})
def numbers(*shape):
    return rng.uniform(-1.0, 1.0, shape).round(3)
s = Scene("s")"""


@dataclass(frozen=True)
class Layer:
    """A primitive or union with an attribute "x"."""

    name: str
    """Of the Python variable."""
    count: int
    mesh: str
    is_union: bool = False


@dataclass(frozen=True)
class SceneProgram:
    """The program of a scene."""

    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def _repr_pretty_(self, printer: Any, cycle: bool) -> None:
        """What hypothesis prints when the test fails."""
        del cycle
        printer.text(f"\n{self.text}\n")

    def build(self) -> Scene:
        """Runs the program."""
        names: dict[str, Any] = {}
        exec(self.text, names)
        scene = names["s"]
        assert isinstance(scene, Scene)
        return scene


class _Writer:
    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw
        self.seed: int = draw(st.integers(0, 999))
        self.lines = [PREAMBLE.format(seed=self.seed)]
        self.dimension: int = draw(st.sampled_from((2, 1, 3)))
        self.layers: list[Layer] = []
        self.frames: list[Layer] = []
        """Primitives with A (d x d) and b (d x 1), for JOINs of several attributes."""
        self.stored: list[str] = []
        """Variables that may become targets."""
        self.shifts: dict[str, str] = {}
        """Meshes with a parameter of their own."""
        self.meshes: list[str] = []
        self.factor: str | None = None
        self.made = 0
        self.energy_count = 0
        self.projections: tuple[str, ...] = draw(
            st.sampled_from((("none",), ("clamp", "abs"), ("none", "clamp", "abs")))
        )

    # -- words ---------------------------------------------------------------------------------------------

    def write(self, line: str) -> None:
        self.lines.append(line)

    def choice(self, *options: Any) -> Any:
        """One of these; the first when shrunk."""
        return self.draw(st.sampled_from(options))

    def formula(self, options: Sequence[str]) -> str:
        """One of these; others for another seed, because the later of many options are rarely sampled."""
        turn = self.seed % len(options)
        return str(self.choice(*options[turn:], *options[:turn]))

    def fresh(self, prefix: str) -> str:
        self.made += 1
        return f"{prefix}{self.made}"

    def mesh(self) -> str:
        return str(self.draw(st.sampled_from(self.meshes)))

    def variable(self, owner: str, name: str, rows: int, cols: int, count: int) -> str:
        """A stored attribute: a variable, or sometimes a constant."""
        if self.choice(True, True, True, False):
            self.write(f'{owner}.add_attribute("{name}", {rows}, {cols}, value=numbers({count}, {rows}, {cols}))')
            self.stored.append(f'{owner}["{name}"]')
        else:
            self.write(f'{owner}.add_constant("{name}", {rows}, {cols}, value=numbers({count}, {rows}, {cols}))')
        return f'{owner}["{name}"]'

    def primitive(self, prefix: str, count: int, mesh: str | None = None) -> tuple[str, str]:
        """Writes a primitive; its variable and mesh."""
        mesh = mesh or self.mesh()
        name = self.fresh(prefix)
        self.write(f'{name} = {mesh}.add_primitive("{name}", {count})')
        return name, mesh

    def joined(self, owner: str, layer: Layer, count: int, arity: int, attribute: str = "x") -> str:
        """Writes a connectivity and a JOIN through it; its variable."""
        name = self.fresh("j")
        index = st.integers(0, layer.count - 1)
        row = st.lists(index, min_size=arity, max_size=arity)
        rows = self.draw(st.lists(row, min_size=count, max_size=count))
        self.write(f'{name}c = {owner}.add_connectivity("{name}c", {layer.name}, {rows}, {arity})')
        self.write(f'{name} = {owner}.add_attribute("{name}", through={name}c, source={layer.name}["{attribute}"])')
        return name

    # -- layers --------------------------------------------------------------------------------------------

    def surroundings(self) -> None:
        """Meshes and parameters of meshes and of the scene."""
        for _ in range(self.choice(1, 2)):
            mesh = self.fresh("m")
            self.write(f'{mesh} = s.add_mesh("{mesh}")')
            self.meshes.append(mesh)
            if self.choice(False, False, True):
                self.shifts[mesh] = self.variable(mesh, "shift", self.dimension, 1, 1)
        if self.choice(False, False, True):
            self.factor = self.variable("s", "k", 1, 1, 1)

    def free(self) -> None:
        """Points that are stored themselves."""
        count = self.choice(2, 1, 3, 5)
        name, mesh = self.primitive("a", count)
        self.variable(name, "x", self.dimension, 1, count)
        self.layers.append(Layer(name, count, mesh))

    def dynamic(self) -> None:
        """Points whose number may change; often none at all."""
        mesh, name = self.mesh(), self.fresh("y")
        count = self.choice(0, 2)
        self.write(f'{name} = {mesh}.add_primitive("{name}", 0, is_dynamic=True)')
        self.write(f'{name}.add_attribute("x", {self.dimension}, 1)')
        self.write(f'{name}["x"].update_value(numbers({count}, {self.dimension}, 1))')
        self.stored.append(f'{name}["x"]')
        self.layers.append(Layer(name, count, mesh))

    def parameterised(self) -> None:
        """Points that follow from parameters of their own, of the mesh, of the scene."""
        d, count = self.dimension, self.choice(2, 1, 3)
        name, mesh = self.primitive("p", count)
        kind = self.choice("matrix", "angle", "square", "product", "kinked", "kinked")
        if kind == "matrix":
            q = self.variable(name, "q", d, self.choice(1, 2), count)
            self.write(f'{name}.add_constant("r", {d}, {d}, value=numbers({count}, {d}, {d}))')
            value = f'({name}["r"] * {q}.col(-1))'
        elif kind == "angle":
            q = self.variable(name, "q", 1, 1, count)
            self.write(f'{name}.add_constant("r", {d}, 1, value=numbers({count}, {d}, 1))')
            value = f'({name}["r"] * {q}.{self.choice("cos", "sin")}() + {name}["r"] * 0.5)'
        elif kind == "square":
            q = self.variable(name, "q", d, 1, count)
            value = f"({q}.hadamard({q}) + 0.5 * {q})"
        elif kind == "kinked":
            value = self.formula(kinked_points(self.variable(name, "q", d, 1, count), d))
        else:
            q, r = self.variable(name, "q", d, 1, count), self.variable(name, "r", 1, 1, count)
            value = f"({r} * {q})"
        self.write(f'{name}.add_attribute("x", computed_attribute={value}{self.around(mesh)})')
        self.layers.append(Layer(name, count, mesh))

    def around(self, mesh: str) -> str:
        """Something of the mesh or scene to add to a point, or nothing."""
        terms = ["", ""]
        if mesh in self.shifts:
            terms += [f" + {self.shifts[mesh]}"]
            terms += [f" + {self.factor} * {self.shifts[mesh]}"] if self.factor else []
        return str(self.choice(*terms))

    def rigid(self) -> None:
        """Points moved by a frame: x = A r + b through one connectivity."""
        d = self.dimension
        if not self.frames or self.choice(False, True):
            count = self.choice(1, 2)
            frame, mesh = self.primitive("f", count)
            self.variable(frame, "A", d, d, count)
            self.variable(frame, "b", d, 1, count)
            self.frames.append(Layer(frame, count, mesh))
        layer = self.choice(*self.frames)
        count = self.choice(2, 1, 4)
        name, mesh = self.primitive("v", count)
        self.write(f'{name}.add_constant("r", {d}, 1, value=numbers({count}, {d}, 1))')
        a = self.joined(name, layer, count, 1, "A")
        self.write(f'{name}b = {name}.add_attribute("b", through={a}c, source={layer.name}["b"])')
        self.write(
            f'{name}.add_attribute("x", computed_attribute={a}.reshape({d}, {d}) * {name}["r"] + {name}b.T'
            f"{self.around(mesh)})"
        )
        self.layers.append(Layer(name, count, mesh))

    def embedded(self) -> None:
        """Points between those of another layer."""
        layer = self.choice(*self.full_layers())
        count, arity = self.choice(2, 1, 3), self.choice(2, 1, 3)
        name, mesh = self.primitive("e", count)
        p = self.joined(name, layer, count, arity)
        first, last = f"{p}.row(0).T", f"{p}.row(-1).T"
        kind = self.choice("mean", "weights", "variable weights", "product", "wave", "cubic", "kinked", "kinked")
        if kind == "mean":
            value = f"0.75 * {first} - 0.5 * {last}"
        elif kind == "weights":
            self.write(f'{name}.add_constant("w", 1, {arity}, value=numbers({count}, 1, {arity}))')
            value = f'({name}["w"] * {p}).T'
        elif kind == "variable weights":
            value = f"({self.variable(name, 'w', 1, arity, count)} * {p}).T"
        elif kind == "product":
            value = f"0.5 * {first} + 0.5 * {first}.hadamard({last})"
        elif kind == "wave":
            value = f"{first}.sin() + {last}"
        elif kind == "kinked":
            value = self.formula(kinked_mixtures(first, last, self.dimension))
        else:
            value = f"{first} * {last}.dot({first})"
        self.write(f'{name}.add_attribute("x", computed_attribute={value}{self.around(mesh)})')
        self.layers.append(Layer(name, count, mesh))

    def neighbours(self) -> None:
        """Points that are sums or means over any number of those of another layer."""
        layer = self.choice(*self.full_layers())
        count, operation = self.choice(2, 1, 3), self.choice("sum", "mean")
        name, mesh = self.primitive("n", count)
        fewest = 1 if operation == "mean" else 0
        row = st.lists(st.integers(0, layer.count - 1), min_size=fewest, max_size=3)
        rows = self.draw(st.lists(row, min_size=count, max_size=count))
        flat, lengths = [index for indices in rows for index in indices], [len(indices) for indices in rows]
        j = self.fresh("j")
        self.write(f'{j}c = {name}.add_connectivity("{j}c", {layer.name}, {flat}, counts={lengths})')
        through = f'through={j}c, source={layer.name}["x"], operation="{operation}"'
        self.write(f'{j} = {name}.add_attribute("{j}", {through})')
        value = self.choice(j, f"0.5 * {j} - {j}.hadamard({j})", kinked_points(j, self.dimension)[0])
        self.write(f'{name}.add_attribute("x", computed_attribute={value}{self.around(mesh)})')
        self.layers.append(Layer(name, count, mesh))

    def union(self, newest: bool = False) -> None:
        """A union of layers, unions among them: some, or the three newest."""
        some = st.lists(st.sampled_from(self.layers), min_size=min(2, len(self.layers)), max_size=3, unique=True)
        members = self.layers[-3:] if newest else self.draw(some)
        count = sum(member.count for member in members)
        mesh, name = self.mesh(), self.fresh("u")
        listed = ", ".join(member.name for member in members)
        self.write(f'{name} = {mesh}.add_primitive_union("{name}", [{listed}])')
        self.write(f'{name}.add_attribute("x")')
        self.layers.append(Layer(name, count, mesh, True))

    def full_layers(self) -> list[Layer]:
        """Layers with instances; the last, which has most behind it, is there thrice to be drawn more often."""
        full = [layer for layer in self.layers if layer.count]
        return [*full, *full[-1:] * 2]

    # -- energies ------------------------------------------------------------------------------------------

    def energy_of(self, y: str, z: str, mesh: str | None) -> str:
        """A number from two column vectors of d entries, and parameters of the mesh or scene."""
        value = self.formula(energies(y, z, self.dimension))
        if self.factor and self.choice(False, True):
            value = f"{self.factor} * ({value})"
        if mesh in self.shifts and self.choice(False, True):
            value = f"({value}) - {y}.dot({self.shifts[mesh]})"
        return value

    def add_energy(self, owner: str, value: str, dynamic: bool = False) -> None:
        projection = self.choice(*self.projections)
        self.energy_count += 1
        name = f"E{self.energy_count}"
        self.write(f'{name} = {owner}.add_attribute("{name}", computed_attribute={value})')
        extra = ", dynamic_instances=True" if dynamic else ""
        self.write(f's.add_energy({name}, projection="{projection}"{extra})')

    def energy(self) -> None:
        """An energy of elements between layers, of a layer itself, of a mesh or of the scene."""
        kinds = ["elements", "elements", "two layers", "layer"] if self.full_layers() else ["layer"]
        kinds += ["shift"] if self.shifts else []
        kinds += ["factor"] if self.factor else []
        kind = self.choice(*kinds)
        if kind in ("elements", "two layers"):
            first = self.choice(*self.full_layers())
            second = self.choice(*self.full_layers()) if kind == "two layers" else None
            mesh, name = self.mesh(), self.fresh("t")
            dynamic = self.choice(False, True)
            count = self.choice(2, 1, 3, 9) if not dynamic else self.choice(0, 1, 3)
            given = "0, is_dynamic=True" if dynamic else f"{count}"
            self.write(f'{name} = {mesh}.add_primitive("{name}", {given})')
            arity = self.choice(2, 1, 3, 4)
            p = self.joined(name, first, count, arity)
            rows = [f"{p}.row({k}).T" for k in range(arity)]
            if second is not None:
                rows.append(f"{self.joined(name, second, count, 1)}.T")
            z = " - ".join(rows[1:]) if len(rows) > 1 else f"({p} * 0.5).T"
            self.add_energy(name, self.energy_of(rows[0], f"({z})", mesh))
        elif kind == "layer":
            layer = self.choice(*self.layers)
            x = f'{layer.name}["x"]'
            self.add_energy(layer.name, self.energy_of(x, x, layer.mesh), self.choice(False, True))
        elif kind == "shift":
            mesh = self.choice(*self.shifts)
            self.add_energy(mesh, self.energy_of(self.shifts[mesh], self.shifts[mesh], mesh))
        else:
            self.add_energy("s", f"{self.factor} ** 3 + {self.factor}.cos()")

    def targets(self) -> None:
        """Some of the variables, in any order, at least one."""
        if not self.stored:
            self.write('s.add_attribute("spare", 1, 1, value=[0.5])')
            self.stored.append('s["spare"]')
        keep = self.draw(st.lists(st.sampled_from((True, True, True, False)), min_size=len(self.stored)))
        chosen = [name for name, kept in zip(self.stored, keep, strict=False) if kept] or self.stored[:1]
        order: Sequence[str] = self.draw(st.permutations(chosen))
        self.write(f"s.add_minimize_target([{', '.join(order)}])")


@st.composite
def scenes(draw: st.DrawFn) -> SceneProgram:
    """Programs of scenes with up to seven layers and three energies."""
    writer = _Writer(draw)
    writer.surroundings()
    writer.free()
    if draw(st.booleans()):  # a tower: layers on layers, each kind where the next builds on it
        writer.parameterised()
        writer.choice(writer.rigid, writer.parameterised, writer.neighbours)()
        writer.union(newest=True)
        writer.embedded()
        writer.choice(writer.embedded, writer.neighbours, writer.rigid)()
        writer.union(newest=True)
    else:
        for _ in range(draw(st.integers(1, 6))):
            writer.choice(
                writer.free,
                writer.embedded,
                writer.union,
                writer.rigid,
                writer.parameterised,
                writer.embedded,
                writer.union,
                writer.neighbours,
                writer.dynamic,
            )()
    for _ in range(draw(st.integers(1, 3))):
        writer.energy()
    writer.targets()
    return SceneProgram(tuple(writer.lines))
