"""A wrong scene or file is refused with one line: the key, what was found, what is expected. Nothing is written."""

import re
import unicodedata
from pathlib import Path

import pytest

from shared.command import COARSE as COARSER
from shared.command import Call, assert_refused, ended
from shared.drawn import draw, scene_data
from shared.ranks import options
from stickslip.geometry.errors import FolderError
from stickslip.workflows.commands.cli import guarded
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import READY, from_dict, read

ROLLER = "shape='cylinder',point=[2.0,-5.0],radius=5.0"
BALL = "shape='sphere',center=[2.0,-5.0],radius=5.0"
SPACE = ["model='3d'", "geometry.width=1.0"]
ROUND = ["model='axisymmetric'", "supports.top.displacement={y=-0.1}"]


def foundation(keys: str) -> str:
    """Another foundation."""
    return f"obstacles.foundation={{{keys}}}"


def wood(*keys: str, **constants: float) -> str:
    """An orthotropic body in place of the block's own."""
    own = {"E_1": 10.0, "E_2": 0.8, "E_3": 0.5, "G_12": 0.6, "nu_12": 0.4, "nu_13": 0.4, "nu_23": 0.3} | constants
    return f"bodies.block={{{','.join([*(f'{key}={value}' for key, value in own.items()), *keys])}}}"


# A word or more of the ready scene `block` overridden -> what the line says.
# fmt: off
WRONG: list[tuple[str, ...]] = [
    # names
    ("contacts.base.surfce='x'", "contacts.base.surfce: unknown key; did you mean surface?"),
    ("supports.top.displacement.y=[[0,1],[1]]", "supports.top.displacement.y.1 = [1]: expected a pair [time, value]"),
    ("contacts.base.friction.nu=1", "friction.nu: unknown key; known: k_T, law, mu"),
    ("geometry.lenght=1", "geometry.lenght: unknown key; did you mean length?"),
    ("solver.tolerence=1", "solver.tolerence: unknown key; did you mean tolerance?"),
    ("suports.top.x=1", "suports: unknown key; did you mean supports?"),
    ("model='plane stran'", 'model = "plane stran": .*did you mean plane strain?'),
    ("units=1", "units = 1: expected a text, in quotes"),
    ("geometry.builder='blok'", 'geometry.builder = "blok": .*did you mean block?'),
    ("geometry.cells='quad'", 'geometry.cells = "quad": .*known: simplex, tensor'),
    ("contacts.base.normal.law='unilatral'", 'contacts.base.normal.law = "unilatral": .*did you mean unilateral?'),
    ("contacts.base.friction.law='culomb'", 'contacts.base.friction.law = "culomb": .*did you mean coulomb?'),
    ("contacts.base.friction={mu=0.3}", "contacts.base.friction.law: missing"),
    ("obstacles.foundation.shape='plan'", 'foundation.shape = "plan": .*did you mean plane?'),
    ("solver.method='uzava'", "solver.method = uzava: .*did you mean uzawa?"),
    ("supports.top.displacement.w=0.0", "top.displacement.w.*known: normal, x, y, z"),
    ("bodies.bloc={E=1.0,nu=0.3}", "bodies.bloc: no such body.*did you mean block?"),
    ("contacts.base.surface='block.botom'", "contacts.base.surface = block.botom: .*did you mean block.bottom?"),
    ("supports.top.boundary='block.tp'", "supports.top.boundary = block.tp: .*did you mean block.top?"),
    ("loads.side={boundary='block.lft',pressure=1.0}", "loads.side.boundary = block.lft: .*did you mean block.left?"),
    ("contacts.base.against='foundatoin'",
     "contacts.base.against = foundatoin: no such obstacle or side; did you mean foundation?"),
    ("contacts.Base={surface='block.left',against='foundation'}", "contacts.Base: a name is made of a-z, 0-9 and _"),
    # orthotropic bodies
    (wood("E=1.0"), "bodies.block.E: unknown key; known: E_1, E_2"),
    (wood("formulation='auto'"), "block.formulation: unknown key; known: E_1"),
    (wood().replace("E_2=0.8,", ""), "block.E_2: missing, it has no default$"),
    (wood("G_13=-1.0"), "bodies.block.G_13 = -1.0: must be positive, in pascal"),
    (wood(nu_12=3.6),
     "bodies.block.nu_12 = 3.6: must lie between -3.536 and 3.536, sqrt(E_1 / E_2): else a pull would gain"),
    (wood(nu_12=2.5, nu_23=0.9),
     "bodies.block.nu_13 = 0.4: with nu_12 = 2.5 and nu_23 = 0.9 a load would gain work: .* is -"),
    (wood("axis_1=[0.0,0.0]"), "axis_1 = [0.0, 0.0]: must be a direction, not zero"),
    (wood("axis_1=[1.0,0.0,0.0]"), "bodies.block.axis_1 = [1.0, 0.0, 0.0]: expected 2 components in this model"),
    (wood("axis_1=[1.0,2.0],axis_2=[-2.0,-4.0]"),
     "bodies.block.axis_2 = [-2.0, -4.0]: is parallel to axis_1; give another direction"),
    (*SPACE, wood("G_13=1.0,G_23=1.0,axis_1=[0.0,1.0,0.0]"),
     "bodies.block.axis_2 = absent, so y: is parallel to axis_1"),
    ("thermal.block={expansion=[1e-5,1e-5,1e-5],temperature=1.0}",
     "thermal.block.expansion = [1e-05, 1e-05, 1e-05]: expected a number; the body has no axes"),
    # types
    ("bodies.block.E='210 GPa'", 'block.E = "210 GPa": expected a number, in Pa$'),
    ("obstacles.foundation.point=['a',0.0]", 'point.0 = "a": expected a number, in m$'),
    ("contacts.base.friction.mu='a'", 'mu = "a": column 1: a is not known'),
    ("contacts.bas.friction.mu=0.2",
     "contacts.bas: there is none in the scene; did you mean base?$"),
    ("contacts.zzz.friction.mu=0.2", "contacts.zzz: there is none in the scene; known: base$"),
    ("supports.to.displacement.x=0.2",
     "supports.to: there is none in the scene (a new one needs boundary / point); did you mean top?$"),
    ("contacts.base.against=[]", "contacts.base.against = []: is empty: name an obstacle or a side"),
    ("supports.top.boundary=''", 'supports.top.boundary = "": no such side; known: block.bottom, '),
    ("bodies.steel.E=1.0", "bodies.steel: there is none .* needs nu); known: block$"),
    ("bodies.block.E=true", "bodies.block.E = true: .*number"),
    ("geometry.length=[1, 2]", "geometry.length = [1, 2]: .*number"),
    ("steps.count=2.5", "steps.count = 2.5: expected a whole number"),
    ("title=3", "title = 3: expected a text"),
    ("bodies.block=3", "bodies.block = 3: expected a table"),
    ("output.pictures='yes'", 'output.pictures = "yes": expected true or false'),
    ("output.error='maybe'", 'output.error = "maybe": expected true or false, or "full" or "rough"'),
    ("output.error_budget='x'", 'output.error_budget = "x": expected a number in s, or "inf"'),
    ("supports.top.displacement.y='fast'", 'top.displacement.y = "fast": column 1: fast is not known'),
    ("supports.top.displacement.y=[0,1]", "displacement.y = [0, 1]: .* or a table"),
    ("bodies.block.E=nan", "bodies.block.E = nan: must be a finite number"),
    ("supports.top.displacement.y=[[0,0],[1,-inf]]", "displacement.y.*= -inf: .*finite"),
    # values
    ("bodies.block.nu=0.51", "bodies.block.nu = 0.51: must lie above -1, and not above 0.5"),
    ("bodies.block.nu=0.5", "bodies.block.formulation='displacement'",
     'bodies.block.nu = 0.5: must lie below 0.5 with formulation = "displacement"'),
    ("bodies.block.formulation='mixed'",
     'bodies.block.formulation = "mixed": not one of these; known: auto, displacement, mean-dilatation'),
    ("bodies.block.E=-1.0", "bodies.block.E = -1.0: must be positive, in pascal"),
    ("bodies.block.density=-1.0", "bodies.block.density = -1.0: must not be negative"),
    ("contacts.base.friction.mu=-0.1", "friction.mu = -0.1: must not be negative"),
    ("contacts.base.friction={law='tresca',bound=[[1,-1]]}",
     "contacts.base.friction.bound = -1.0: must not be negative, in pascal"),
    ("contacts.base.friction.k_T=0.0", "friction.k_T = 0.0: must be positive, in Pa/m"),
    ("contacts.base.friction={law='compliance',c_T=1.0}",
     'contacts.base.friction: law = "compliance" .* needs normal = { law = "compliance"'),
    *(
        (f"contacts.base.friction={{law='{law}',{keys}}}", f"contacts.base.friction{said}")
        for law, keys, said in (
            ("cohesion", "a=-1.0,mu=0.3", ".a = -1.0: must not be negative, in pascal"),
            ("cohesion", "a=1.0,mu=-0.3", ".mu = -0.3: must not be negative"),
            ("cohesion", "mu=0.3", ".a: missing, it has no default"),
            ("pressure_dependent", "mu=[]", ".mu = []: a table needs at least one [value, mu]"),
            ("pressure_dependent", "mu=[[2,0.3],[1,0.2]]", ".mu = [2.0, 1.0]: its first column must increase"),
            ("pressure_dependent", "mu=[[0,0.3],[1,0.1]]", ".mu = .*the bound mu p_n falls as the pressure grows"),
            ("slip_dependent", "mu=0.3", ".mu = 0.3: expected a list"),
            ("slip_dependent", "mu=[[0,0.3],[1,-0.2]]", ".mu = -0.2: mu must not be negative"),
            ("slip_dependent", "mu=[[-1,0.3]]", ".mu = [-1.0]: its first column must increase from 0"),
            ("rate_dependent", "mu=[[0,0.3],[1,0.2]]", ".mu = .*: mu falls as the slip rate grows, so that bodies"),
            ("rate_dependent", "mu='0.3-0.1*V'", '.mu = "0.3-0.1*V": is -.* at V = .*; must not be negative'),
            ("rate_dependent", "mu='0.3+1/(1+V)'", '.mu = "0.3+1/(1+V)": mu falls as the slip rate grows'),
            ("rate_dependent", "mu='0.3+x*V'", '.mu = "0.3+x*V": x: mu depends on V alone'),
            ("rate_dependent", "mu='0.3+W'", '.mu = "0.3+W": column 5: W is not known'),
            ("static_kinetic", "mu_s=0.2,mu_k=0.3,slip_length=1.0", ".mu_s = 0.2: must not be below mu_k = 0.3"),
            ("static_kinetic", "mu_s=0.2,mu_k=0.1,slip_length=0.0", ".slip_length = 0.0: must be positive, in met"),
            ("static_kinetic", "mu_s=0.2,mu_k=0.1", ".slip_length: missing, it has no default"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1.0,0.0]", ".axis = [1.0, 0.0]: expected a direct"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.0,axis=[1,0,0]", ".mu_2 = 0.0: must be positive"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1,0,0],k_T=1.0", ".k_T = 1.0: .*rigid before slip"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1,0,0]", ".law = .*: a plane model has one tangential"),
        )
    ),
    ("contacts.base.friction={law='rate_dependent',mu=[[0,0.3]]}",
     "steps.seconds = false: contacts.base.friction depends on slip rates: say .* seconds = true"),
    ("contacts.base.friction={law='rate_dependent',mu=[[0,0.3]]}", "steps.seconds=true", "solver.method=nsgs",
     "contacts.base.friction.law = rate_dependent: solver.method = nsgs has no friction by slip rate; use cond"),
    ("supports.top.displacement.x='V*t'",
     'supports.top.displacement.x = "V*t": V: the slip rate, which friction laws alone depend on'),
    ("contacts.base.friction={law='static_kinetic',mu_s=0.3,mu_k=0.2,slip_length=1.0}", "solver.method=regularised",
     "contacts.base.friction.law = static_kinetic: solver.method = regularised works with coulomb"),
    (*SPACE, "obstacles.foundation={shape='plane',point=[0.0,0.0,0.0],normal=[0.0,0.0,1.0]}",
     "contacts.base.friction={law='orthotropic_coulomb',mu_1=0.3,mu_2=0.2,axis=[0.0,0.0,1.0]}",
     "supports.top.displacement={x=0.1,y=0.0,z=-0.1}", "probes.corner.point=[0.0,0.0,2.0]",
     "contacts.base.friction.axis = [0.0, 0.0, 1.0]: is normal to the side at some point"),
    ("contacts.base.normal.law='tied'", "contacts.base.friction: a tied surface sticks, leave it out"),
    ("contacts.base.normal={law='compliance',c_n=1.0,m_n=0.5}", "contacts.base.normal.m_n = 0.5: must be at least 1"),
    ("geometry.mesh_size=0.0", "geometry.mesh_size = 0.0: must be positive, in metres"),
    ("obstacles.foundation.normal=[0.0,0.0]", "foundation.normal = [0.0, 0.0]: .*not be zero"),
    ("steps.count=0", "steps.count = 0: must be a whole number from 1"),
    ("steps.end=0.0", "steps.end = 0.0: must be positive"),
    ("steps.end=1e-300", "steps.end = 1e-300: must be from 1e-100 to 1e+100 s"),
    ("steps.end=1e300", "steps.end = 1e+300: must be from 1e-100 to"),
    ("solver.tolerance=0.0", "solver.tolerance = 0.0: must lie between 0 and 1"),
    ("supports.top.displacement.y=[[1,0],[0.5,-0.1]]", "supports.top.displacement.y = [1.0, 0.5]: times must increase"),
    ("supports.top.displacement.y=[[-1,0],[1,-0.1]]",
     "supports.top.displacement.y = [-1.0, 1.0]: times must increase, from 0 or later"),
    ("supports.top.displacement.y=[]", "top.displacement.y = []: .*at least one"),
    # beyond all numbers, and beyond all names
    ("bodies.block.E=1e-300", "bodies.block.E = 1e-300: must be 0, or from 1e-100 to 1e+100 in size"),
    ("bodies.block.E=1e300", "bodies.block.E = 1e+300: must be 0, or from"),
    ("bodies.block.E=" + "9" * 400, "bodies.block.E = ...: is too large"),
    ("contacts.base.friction.mu=1e120", "contacts.base.friction.mu = 1e+120: must be 0, or from"),
    ("supports.top.displacement.y=-1e-170", "supports.top.displacement.y = -1e-170: must be 0, or from"),
    ("supports.top.displacement.y=[[0,0],[1,-1e170]]", "supports.top.displacement.y.1.1 = -1e+170: must be 0, or from"),
    ("gravity.acceleration=[0.0,1e150]", "bodies.block.density=1.0", "gravity.acceleration.1 = 1e+150: must be 0"),
    ("supports.top.displacement={x=0.0,y='-1e-170*t'}", "motions of about 1e-170 and tractions .* leave the range"),
    ("supports.top.displacement={x=0.0,y=-1e90}", "bodies.block.E=1e90", "motions of about .* check the units of E"),
    ("gravity.acceleration=[0.0,-1e90]", "bodies.block.density=1e90", "tractions of about .* leave the range of num"),
    ("bodies.block.nu=-0.9999999999", "bodies.block.nu = -0.9999999999: must lie above -1 by 1e-05, or shear"),
    ("contacts.base.normal={law='compliance',c_n=1e15}",
     "contacts.base.normal.c_n = 1e+15: penetrations drown in rounding, at most 2.5e+08 here"),
    ("contacts.base.normal={law='compliance',c_n=1e20,m_n=2.0}",
     "contacts.base.normal.c_n = 1e+20: penetrations drown in rounding, at most 1.6e+16 here"),
    (f"probes.{'n' * 250}.point=[0.5,0.5]", "probes = nnn.*nnn: a name has at most 120 letters"),
    # number of components
    ("obstacles.foundation.point=[0.0,0.0,0.0]", "foundation.point = [.*]: expected 2 comp"),
    ("loads.side={boundary='block.left',traction=[1.0,0.0,0.0]}", "side.traction.*expected 2 "),
    ("bodies.block.density=1.0", "gravity.acceleration=[-9.81]", "acceleration = [-9.81]"),
    ("probes.corner.point=[0.0]", "probes.corner.point = [0.0]: expected 2 components"),
    ("supports.top.displacement.z=0.0", "displacement.z: a plane model has x and y"),
    ("obstacles.foundation.displacement={z=0.0}", "displacement.*plane model has x and"),
    ("geometry.width=1.0", "geometry.width = 1.0: a plane model has no width"),
    ("model='3d'", "geometry.width: missing"),
    # what is missing, or too much
    ("bodies.block={nu=0.3}", "bodies.block.E: missing"),
    ("bodies={}", "bodies.block: missing, this body of the geometry needs E and nu"),
    ("contacts.base.normal={law='compliance'}", "contacts.base.normal.c_n: missing"),
    ("loads.side={boundary='block.left',traction=[1.0,0.0],pressure=1.0}",
     "loads.side.traction / pressure: exactly one"),
    ("loads.side={boundary='block.left'}", "loads.side.traction / pressure / force: exactly"),
    ("supports.new={displacement={x=0.0}}",
     "supports.new: there is none in the scene (a new one needs boundary / point)"),
    ("supports.top.point=[0.0,2.0]", "supports.top.boundary / point: .*exactly one"),
    ("supports.top.displacement={}", "top.displacement = {}: name at least one"),
    ("supports.new={point=[0.0,2.0],displacement={normal=0.0}}",
     "supports.new.displacement.normal = given: a point has no normal"),
    ("springs.S={at='block.left',stiffness=[1.0,0.0]}", "springs.S: a name is made of a-z, 0-9 and _"),
    ("gravity.acceleration=[0.0,-9.81]", "gravity: no body has a density; set bodies."),
    ("contacts.second={surface='block.bottom',against='foundation'}",
     "contacts.second.surface = block.bottom: contacts.base has the same slave and the same partner"),
    ("periodic.sides={boundary='block.left',with='block.left'}",
     "periodic.sides.with = block.left: a side cannot be periodic with itself"),
    ("periodic.sides={boundary='block.left'}", "periodic.sides.with: missing"),
    # round obstacles
    (foundation("shape='cylinder',point=[2.0,-5.0]"), "foundation.radius: missing"),
    (foundation("shape='cylinder',point=[2.0,-5.0],radius=-5.0"),
     "foundation.radius = -5.0: must be positive, in metres"),
    (foundation(f"{ROLLER},inside='yes'"), 'foundation.inside = "yes": expected true or false'),
    (foundation(f"{ROLLER},axis=[0.0,0.0,1.0]"), "foundation.axis = .*stands along z; remove the key"),
    (*SPACE, foundation("shape='cylinder',point=[2.0,0.5,-5.0],radius=5.0"),
     "foundation.axis.*missing, the direction of the cylinder's axis"),
    (*SPACE, foundation("shape='cylinder',point=[2.0,0.5,-5.0],radius=5.0,axis=[0.0,0.0,0.0]"),
     "foundation.axis = .*must not be zero"),
    (foundation(BALL), 'foundation.shape = "sphere": .*use "cylinder"'),
    (*SPACE, foundation(BALL), "center = [2.0, -5.0]: expected 3 components"),
    (foundation("shape='sphere',centre=[2.0,-5.0],radius=5.0"), "foundation.centre: unknown key; did you mean center?"),
    # obstacles that move
    ("obstacles.foundation.rotation={angle=0.1}", "foundation.rotation.point: missing"),
    ("obstacles.foundation.rotation={point=[0.0,0.0]}", "foundation.rotation.angle: missing"),
    ("obstacles.foundation.rotation={angle='90 degrees',point=[0.0,0.0]}",
     'foundation.rotation.angle = "90 degrees": expected a number in rad, or a table'),
    ("obstacles.foundation.rotation={angle=0.1,point=[0.0,0.0],axis=[0.0,0.0,1.0]}",
     "foundation.rotation.axis = .*a plane model turns about z; remove the key"),
    ("obstacles.foundation.force={y=1.0}", "obstacles.foundation.displacement={y=1.0}",
     "foundation.force.y: displacement.y is prescribed too; keep one"),
    ("obstacles.foundation.force=[1.0]", "foundation.force = [1.0]: expected a table"),
    ("obstacles.foundation.force={z=1.0}", "foundation.force.z = given: a plane model has x and y only"),
    ("obstacles.foundation.force={y=1.0}", "solver.method='uzawa'",
     "solver.method = uzawa: cannot move obstacles.foundation by a force; use condensed-newton"),
    ("obstacles.foundation.force={x=1.0}", "contacts.base={surface='block.bottom',against='foundation'}",
     "nothing resists the motion of obstacles.foundation along x, which a force moves"),
    # order and gap
    ("geometry.order=3", "geometry.order = 3: .*known: 1, 2"),
    ("geometry.order='quadratic'", 'geometry.order = "quadratic": .*known: 1, 2'),
    ("contacts.base.gap_offset='1 mm'", 'contacts.base.gap_offset = "1 mm": column 3: invalid syntax'),
    # axisymmetric models
    (*ROUND, "loads.side={boundary='block.right',force=[1.0,0.0]}",
     "loads.side.force = [1.0, 0.0]: a radial force has no resultant; use traction or pressure"),
    (*ROUND, "obstacles.foundation.displacement={x=0.1}", "foundation.displacement.x = given: breaks the symmetry"),
    (*ROUND, "obstacles.foundation.rotation={angle=0.1,point=[0.0,0.0]}",
     "foundation.rotation = given: an axisymmetric model has none"),
    (*ROUND, foundation("shape='sphere',center=[1.0,-5.0],radius=5.0"),
     "foundation.center = [1.0, -5.0]: must lie on the axis of symmetry"),
    (*ROUND, foundation("shape='cylinder',point=[0.0,0.0],axis=[1.0,0.0],radius=5.0"),
     "foundation.axis = [1.0, 0.0]: expected [0.0, 1.0], the axis of symmetry"),
    (*ROUND, "gravity.acceleration=[1.0,0.0]", "bodies.block.density=1.0",
     "gravity.acceleration = [1.0, 0.0]: .*along the axis y alone"),
    ("model='axisymmetric'", "axis of symmetry and supports.top: contradict each other at the point (0, 2) at t = 2"),
    (*ROUND, "contacts.base.surface='block.left'",
     "contacts.base.surface = block.left: lies on the axis of symmetry and has no area"),
    (*ROUND, "loads.side={boundary='block.left',force=[0.0,1.0]}",
     "loads.side.boundary = block.left: lies on the axis of symmetry and has no area"),
    # mechanics, known before solving
    ("supports={}", "contacts={}", "supports: nothing resists the .* of the body; add a support"),
    ("supports.top.displacement={y=-0.1}", "contacts.base={surface='block.bottom',against='foundation'}",
     "supports: nothing resists the translation along x"),
    ("supports.top.displacement={y=-0.1}", "solver.method='uzawa'",
     "solver.method = uzawa: .*held by contact alone; use condensed-newton"),
    # known when meshed
    ("supports.new={boundary='block.top',displacement={x=1.0}}",
     "supports.new and supports.top: contradict each other at the point (.*, 2) at t = 1"),
    ("supports.new={boundary='block.top',displacement={x=[[0,0],[1,0],[2,1]]}}",
     "supports.new and supports.top: contradict each other at the point (.*, 2) at t = 2"),
    ("periodic.sides={boundary='block.left',with='block.top'}",
     "periodic.* block.left and block.top: their meshes do not match"),
    ("probes.corner.point=[10.0,10.0]", "probes.corner.point = [10.0, 10.0]: lies outside"),
    # the override itself
    ("solver.method", "--set solver.method: expected KEY=VALUE"),
    ("geometry.length.x=3", "--set geometry.length.x=3: length is not a table"),
    ("solver.method='''a\nb'''", "solver.method = a b: known: auto"),
]
# fmt: on
COARSE = options(["geometry.mesh_size=1.0", "geometry.contact_mesh_size=1.0"])


def pattern(said: str) -> str:
    """As a regular expression; of its signs only .* and $ are used."""
    return re.escape(said).replace(r"\.\*", ".*").replace(r"\$", "$")


def about(said: str) -> tuple[str, ...]:
    """The first case whose line says so."""
    return next(case for case in WRONG if said in case[-1])


@pytest.mark.parametrize("case", WRONG, ids=lambda case: case[-1])
def test_wrong_scene_is_refused_in_a_line_and_nothing_written(case: tuple[str, ...], call: Call, folder: Path) -> None:
    *overrides, said = case
    spoken = call("run", "block", "-q", "-o", "out", *COARSE, *options(overrides))
    assert_refused(spoken, pattern(said), folder, [])
    assert spoken[2].count("\n") == 1 or "model='3d'" in overrides  # then other tables are wrong too


@pytest.mark.parametrize("said", ["mean surface?", "not above 0.5", "nothing resists the .* of the body", "held by"])
def test_plan_refuses_what_run_refuses(said: str, call: Call, folder: Path) -> None:
    *overrides, line = about(said)
    assert_refused(call("plan", "block", *options(overrides)), pattern(line), folder, [])


@pytest.mark.parametrize("said", ["did you mean tolerance?", "lies outside", "contradict each other"])
def test_a_process_refuses_as_the_function_does(said: str, spawn: Call, folder: Path) -> None:
    *overrides, line = about(said)
    spoken = spawn("run", "block", "-q", "-o", "out", *COARSE, *options(overrides))
    assert_refused(spoken, pattern(line), folder, [])


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("model = 'plane strain\n", r"scene\.toml: not valid TOML: Expected"),
        ("title = 'a'\ntitle = 'b'\n", r"scene\.toml: not valid TOML: .*line 2"),
        ("", r"scene\.toml: .*missing"),
        ("model = '3d'\n[geometry]\nbuilder = 'block'", r"scene\.toml:2: geometry\.[a-z_]+: missing"),
        ("a = " + "[" * 40 + "]" * 40, r"scene\.toml:1: a\.0\.0.*: tables and lists more than 20 deep"),
    ],
    ids=["quote left open", "key twice", "empty", "little", "nested"],
)
def test_file_that_is_no_scene_is_refused(text: str, pattern: str, call: Call, folder: Path) -> None:
    (folder / "scene.toml").write_text(text)
    assert_refused(call("run", "scene.toml", "-q"), pattern, folder, ["scene.toml"])


def test_bytes_that_are_no_text_are_refused(call: Call, folder: Path) -> None:
    (folder / "scene.toml").write_bytes(b"title = '\xff\xfe'")
    assert_refused(call("run", "scene.toml", "-q"), r"scene\.toml: is not a text file", folder, ["scene.toml"])


def test_missing_file_is_refused_with_the_nearest_ready_scene(call: Call, folder: Path) -> None:
    assert_refused(
        call("run", "blok", "-q"), r"blok: no such file, nor a ready scene; did you mean block\?", folder, []
    )


def test_folder_in_place_of_a_file_is_refused(call: Call, folder: Path) -> None:
    (folder / "mine").mkdir()
    assert_refused(call("run", "mine", "-q"), r"mine: is a folder; name a scene file", folder, ["mine"])


def test_a_folder_of_results_does_not_hide_the_ready_scene(call: Call, folder: Path) -> None:
    (folder / "block").mkdir()
    assert call("plan", "block")[0] == 0


def test_error_names_the_scene_file(call: Call, folder: Path) -> None:
    text = (READY / "block.toml").read_text().replace("nu = 0.3", "nu = 0.7")
    (folder / "mine.toml").write_text(text)
    assert_refused(call("run", "mine.toml", "-q"), r"mine\.toml:\d+: bodies\.block\.nu = 0\.7", folder, ["mine.toml"])


def test_mark_that_editors_put_in_front_is_no_mistake(call: Call, folder: Path) -> None:
    text = "\ufeff" + (READY / "block.toml").read_text()
    (folder / "mine.toml").write_text(text, encoding="utf-8")
    assert read(folder / "mine.toml") == read("block")
    (folder / "mine.toml").write_text(text.replace("nu = 0.3", "nu = 0.7"), encoding="utf-8")
    assert_refused(call("run", "mine.toml", "-q"), r"mine\.toml:\d+: bodies\.block\.nu = 0\.7", folder, ["mine.toml"])


MISTAKES = {  # in the ready scene `block` -> what is said of it
    ("title = ", "titel = "): r"titel: unknown key; did you mean title\?",
    ("height = 2.0", "height = -2.0"): r"geometry\.height = -2\.0: must be positive",
    ("E = 1.0", 'E = "steel"'): r'bodies\.block\.E = "steel": expected a number',
    ("nu = 0.3", ""): r"bodies\.block\.nu: missing",
    ("surface = ", "surfce = "): r"contacts\.base\.surfce: unknown key; did you mean surface\?",
    ("mu = 0.3", "mu = 0.3, eta = 2"): r"contacts\.base\.friction\.eta: unknown key",
    ("[1, 0], [2, 0.05]", "[1], [2, 0.05]"): r"supports\.top\.displacement\.x\.1 = \[1\]: expected a pair",
    ("count = 2", "count = 2.5"): r"steps\.count = 2\.5: expected a whole number",
}
UNKNOWN_NAMES = {
    ("block.bottom", "block.botom"): r"contacts\.base\.surface = block\.botom: no such side",
    ('"foundation"', '"foundatoin"'): r"contacts\.base\.against = foundatoin: no such obstacle or side",
    ('"block.top"', '"block.tp"'): r"supports\.top\.boundary = block\.tp: no such side",
}


@pytest.mark.parametrize("mistakes", [MISTAKES, UNKNOWN_NAMES])
def test_all_mistakes_are_said_with_their_lines(mistakes: dict[tuple[str, str], str], call: Call, folder: Path) -> None:
    text = (READY / "block.toml").read_text()
    expected = []
    for (right, wrong), said in mistakes.items():
        assert text.count(right) == 1
        line = 1 + text[: text.index(right)].count("\n")
        text = text.replace(right, wrong)
        lacks = "missing" in said  # then it is the line of the table
        expected.append((line - 2 if lacks else line, said))
    (folder / "mine.toml").write_text(text)
    _, err = ended(call("plan", "mine.toml"), 2)
    found = err.splitlines()
    assert len(found) == len(expected), err
    for one, (line, said) in zip(found, sorted(expected), strict=True):
        assert re.match(rf"stickslip: mine\.toml:{line}: {said}", one), one


def test_a_key_of_set_has_no_line(call: Call, folder: Path) -> None:
    (folder / "mine.toml").write_text((READY / "block.toml").read_text().replace("nu = 0.3", "nu = 0.7"))
    _, _, err = call("plan", "mine.toml", "--set", "bodies.block.nu=0.8")
    assert err.startswith("stickslip: mine.toml: bodies.block.nu = 0.8: ")


def test_a_geometry_file_is_no_scene(call: Call, folder: Path) -> None:
    (folder / "x.step").write_text("ISO-10303-21;")
    said = r"x\.step: is a geometry file; for a scene: stickslip new --from x\.step$"
    assert_refused(call("run", "x.step", "-q"), said, folder, ["x.step"])


def test_overrides_add_a_whole_noun(call: Call, folder: Path) -> None:
    keys = ("boundary=block.left", "pressure=.1")
    assert call("plan", "block", *(f"--set=loads.side.{key}" for key in keys))[0] == 0


def test_file_in_place_of_the_results_folder_is_not_overwritten(call: Call, folder: Path) -> None:
    (folder / "out").write_text("mine")
    spoken = call("run", "block", "-q", "-o", "out", *COARSER)
    assert_refused(spoken, r"out: .*choose another folder with -o", folder, ["out"])
    assert (folder / "out").read_text() == "mine"


def test_a_damaged_file_ends_the_command_with_code_2(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = draw(tmp_path / "b.msh", 2)
    path.write_bytes(path.read_bytes()[:2000])
    assert guarded(lambda: from_dict(scene_data(path))) == 2
    out, err = capfd.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("stickslip: b.msh: ")


def test_a_name_of_a_file_is_no_command_to_the_terminal(call: Call, folder: Path) -> None:
    """Neither in a refusal, nor in what is said of results; a title neither."""
    name = "a\x1b[31m\x9b2J\u202eb"
    (folder / f"{name}.toml").write_text((READY / "block.toml").read_text().replace("nu = 0.3", "nu = 0.7"))
    shown = r"a\\x1b\[31m\\x9b2J\\u202eb\.toml:\d+: bodies\.block\.nu"
    assert_refused(call("plan", f"{name}.toml"), shown, folder, [f"{name}.toml"])
    title = '--set=title="a\\u001b[2J\\u009b3J"'
    for words in (["run", "block", *COARSER, title, "-o", name], ["report", name], ["compare", name, name]):
        _, out, err = call(*words)
        assert "\\x1b[" in out
        assert not {c for c in out + err if unicodedata.category(c) in ("Cc", "Cf")} - {"\n", "\t"}
    assert "\x1b" not in (folder / name / "run.log").read_text()


def test_a_hint_can_be_pasted(call: Call, folder: Path) -> None:
    (folder / "it's.geo").write_text("// nothing")
    said = r"it's\.geo: is a geometry file; for a scene: stickslip new --from 'it'\"'\"'s\.geo'$"
    assert_refused(call("plan", "it's.geo"), said, folder, ["it's.geo"])


def test_a_folder_whose_name_no_disk_takes_is_refused(call: Call, folder: Path) -> None:
    assert_refused(call("run", "block", "-q", *COARSE, "-o", "n" * 250), "File name too long", folder, [])
    with pytest.raises(FolderError, match="name a folder that may be made"):
        run(read("block"), "a\0b")
