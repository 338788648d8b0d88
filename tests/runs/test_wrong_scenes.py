"""A wrong scene is refused with one line: the key, what was found, what is expected. Nothing is written."""

from pathlib import Path

import pytest

from shared.command import Call, assert_refused
from shared.ranks import options

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
WRONG = {
    # names
    "unknown key": (["contacts.base.surfce='x'"], r"contacts\.base\.surfce: unknown key; did you mean surface\?"),
    "row of a table without a value": (
        ["supports.top.displacement.y=[[0,1],[1]]"],
        r"supports\.top\.displacement\.y\.1 = \[1\]: expected a pair \[time, value\]",
    ),
    "unknown key of a law": (["contacts.base.friction.nu=1"], r"friction\.nu: unknown key; known: k_T, law, mu"),
    "unknown key of the geometry": (["geometry.lenght=1"], r"geometry\.lenght: unknown key; did you mean length\?"),
    "unknown key of the solver": (["solver.tolerence=1"], r"solver\.tolerence: unknown key; did you mean tolerance\?"),
    "unknown table": (["suports.top.x=1"], r"suports: unknown key; did you mean supports\?"),
    "unknown model": (["model='plane stran'"], r'model = "plane stran": .*did you mean plane strain\?'),
    "units that are a number": (["units=1"], r"units = 1: expected a text, in quotes"),
    "unknown builder": (["geometry.builder='blok'"], r'geometry\.builder = "blok": .*did you mean block\?'),
    "unknown cells": (["geometry.cells='quad'"], r'geometry\.cells = "quad": .*known: simplex, tensor'),
    "unknown normal law": (
        ["contacts.base.normal.law='unilatral'"],
        r'contacts\.base\.normal\.law = "unilatral": .*did you mean unilateral\?',
    ),
    "unknown friction law": (
        ["contacts.base.friction.law='culomb'"],
        r'contacts\.base\.friction\.law = "culomb": .*did you mean coulomb\?',
    ),
    "friction without a law": (["contacts.base.friction={mu=0.3}"], r"contacts\.base\.friction\.law: missing"),
    "unknown shape": (["obstacles.foundation.shape='plan'"], r'foundation\.shape = "plan": .*did you mean plane\?'),
    "unknown method": (["solver.method='uzava'"], r"solver\.method = uzava: .*did you mean uzawa\?"),
    "unknown direction": (["supports.top.displacement.w=0.0"], r"top\.displacement\.w.*known: normal, x, y, z"),
    "unknown body": (["bodies.bloc={E=1.0,nu=0.3}"], r"bodies\.bloc: no such body.*did you mean block\?"),
    "unknown side of a contact": (
        ["contacts.base.surface='block.botom'"],
        r"contacts\.base\.surface = block\.botom: .*did you mean block\.bottom\?",
    ),
    "unknown side of a support": (
        ["supports.top.boundary='block.tp'"],
        r"supports\.top\.boundary = block\.tp: .*did you mean block\.top\?",
    ),
    "unknown side of a load": (
        ["loads.side={boundary='block.lft',pressure=1.0}"],
        r"loads\.side\.boundary = block\.lft: .*did you mean block\.left\?",
    ),
    "unknown obstacle": (
        ["contacts.base.against='foundatoin'"],
        r"contacts\.base\.against = foundatoin: no such obstacle or side; did you mean foundation\?",
    ),
    "name in capitals": (
        ["contacts.Base={surface='block.left',against='foundation'}"],
        r"contacts\.Base: a name is made of a-z, 0-9 and _",
    ),
    # orthotropic bodies
    "orthotropic and isotropic": ([wood("E=1.0")], r"bodies\.block\.E: unknown key; known: E_1, E_2"),
    "orthotropic with averages": ([wood("formulation='auto'")], r"block\.formulation: unknown key; known: E_1"),
    "constant that is missing": ([wood().replace("E_2=0.8,", "")], r"block\.E_2: missing, it has no default$"),
    "negative modulus": ([wood("G_13=-1.0")], r"bodies\.block\.G_13 = -1\.0: must be positive, in pascal"),
    "ratio beyond its bound": (
        [wood(nu_12=3.6)],
        r"bodies\.block\.nu_12 = 3\.6: must lie between -3\.536 and 3\.536, sqrt\(E_1 / E_2\): else a pull would gain",
    ),
    "ratios that gain work together": (
        [wood(nu_12=2.5, nu_23=0.9)],
        r"bodies\.block\.nu_13 = 0\.4: with nu_12 = 2\.5 and nu_23 = 0\.9 a load would gain work: .* is -",
    ),
    "axis of no direction": (
        [wood("axis_1=[0.0,0.0]")],
        r"axis_1 = \[0\.0, 0\.0\]: must be a direction, not zero",
    ),
    "axis in space of a plane model": (
        [wood("axis_1=[1.0,0.0,0.0]")],
        r"bodies\.block\.axis_1 = \[1\.0, 0\.0, 0\.0\]: expected 2 components in this model",
    ),
    "axes that are parallel": (
        [wood("axis_1=[1.0,2.0],axis_2=[-2.0,-4.0]")],
        r"bodies\.block\.axis_2 = \[-2\.0, -4\.0\]: is parallel to axis_1; give another direction",
    ),
    "axis along the default of the other": (
        [*SPACE, wood("G_13=1.0,G_23=1.0,axis_1=[0.0,1.0,0.0]")],
        r"bodies\.block\.axis_2 = absent, so y: is parallel to axis_1",
    ),
    "expansion by axis of a body without axes": (
        ["thermal.block={expansion=[1e-5,1e-5,1e-5],temperature=1.0}"],
        r"thermal\.block\.expansion = \[1e-05, 1e-05, 1e-05\]: expected a number; the body has no axes",
    ),
    # types
    "text for a number": (["bodies.block.E='210 GPa'"], r'block\.E = "210 GPa": expected a number, in Pa$'),
    "text in a list": (["obstacles.foundation.point=['a',0.0]"], r'point\.0 = "a": expected a number, in m$'),
    "text for a number without a unit": (["contacts.base.friction.mu='a'"], r'mu = "a": expected a number$'),
    "misspelt name": (
        ["contacts.bas.friction.mu=0.2"],
        r"contacts\.bas: there is none .* \(a new one needs surface, against, friction\.law\); did you mean base\?$",
    ),
    "name of nothing": (["bodies.steel.E=1.0"], r"bodies\.steel: there is none .* needs nu\); known: block$"),
    "truth for a number": (["bodies.block.E=true"], r"bodies\.block\.E = true: .*number"),
    "list for a number": (["geometry.length=[1, 2]"], r"geometry\.length = \[1, 2\]: .*number"),
    "fraction for a whole number": (["steps.count=2.5"], r"steps\.count = 2\.5: expected a whole number"),
    "number for a text": (["title=3"], r"title = 3: expected a text"),
    "number for a table": (["bodies.block=3"], r"bodies\.block = 3: expected a table"),
    "text for a truth": (["output.pictures='yes'"], r'output\.pictures = "yes": expected true or false'),
    "text for a value in time": (
        ["supports.top.displacement.y='fast'"],
        r'top\.displacement\.y = "fast": column 1: fast is not known',
    ),
    "list for a value in time": (["supports.top.displacement.y=[0,1]"], r"displacement\.y = \[0, 1\]: .* or a table"),
    "not a number": (["bodies.block.E=nan"], r"bodies\.block\.E = nan: must be a finite number"),
    "infinite in a table": (["supports.top.displacement.y=[[0,0],[1,-inf]]"], r"displacement\.y.*= -inf: .*finite"),
    # values
    "incompressible": (["bodies.block.nu=0.51"], r"bodies\.block\.nu = 0\.51: must lie above -1, and not above 0\.5"),
    "incompressible displacements": (
        ["bodies.block.nu=0.5", "bodies.block.formulation='displacement'"],
        r'bodies\.block\.nu = 0\.5: must lie below 0\.5 with formulation = "displacement"',
    ),
    "unknown formulation": (
        ["bodies.block.formulation='mixed'"],
        r'bodies\.block\.formulation = "mixed": not one of these; known: auto, displacement, mean-dilatation',
    ),
    "negative stiffness": (["bodies.block.E=-1.0"], r"bodies\.block\.E = -1\.0: must be positive, in pascal"),
    "negative density": (["bodies.block.density=-1.0"], r"bodies\.block\.density = -1\.0: must not be negative"),
    "negative friction": (["contacts.base.friction.mu=-0.1"], r"friction\.mu = -0\.1: must not be negative"),
    "negative bound": (
        ["contacts.base.friction={law='tresca',bound=[[1,-1]]}"],
        r"contacts\.base\.friction\.bound = -1\.0: must not be negative, in pascal",
    ),
    "no stiffness before slip": (
        ["contacts.base.friction.k_T=0.0"],
        r"friction\.k_T = 0\.0: must be positive, in Pa/m",
    ),
    "bound by a penetration that there is not": (
        ["contacts.base.friction={law='compliance',c_T=1.0}"],
        r'contacts\.base\.friction: law = "compliance" .* needs normal = \{ law = "compliance"',
    ),
    **{
        f"{law}: {keys}": ([f"contacts.base.friction={{law='{law}',{keys}}}"], f"contacts\\.base\\.friction{pattern}")
        for law, keys, pattern in (
            ("cohesion", "a=-1.0,mu=0.3", r"\.a = -1\.0: must not be negative, in pascal"),
            ("cohesion", "a=1.0,mu=-0.3", r"\.mu = -0\.3: must not be negative"),
            ("cohesion", "mu=0.3", r"\.a: missing, it has no default"),
            ("pressure_dependent", "mu=[]", r"\.mu = \[\]: a table needs at least one \[value, mu\]"),
            ("pressure_dependent", "mu=[[2,0.3],[1,0.2]]", r"\.mu = \[2\.0, 1\.0\]: its first column must increase"),
            ("pressure_dependent", "mu=[[0,0.3],[1,0.1]]", r"\.mu = .*the bound mu p_n falls as the pressure grows"),
            ("slip_dependent", "mu=0.3", r"\.mu = 0\.3: expected a list"),
            ("slip_dependent", "mu=[[0,0.3],[1,-0.2]]", r"\.mu = -0\.2: mu must not be negative"),
            ("slip_dependent", "mu=[[-1,0.3]]", r"\.mu = \[-1\.0\]: its first column must increase from 0"),
            ("rate_dependent", "mu=[[0,0.3],[1,0.2]]", r"\.mu = .*: mu falls as the slip rate grows, so that bodies"),
            ("rate_dependent", "mu='0.3-0.1*V'", r"\.mu = \"0\.3-0\.1\*V\": is -.* at V = .*; must not be negative"),
            ("rate_dependent", "mu='0.3+1/(1+V)'", r"\.mu = \"0\.3\+1/\(1\+V\)\": mu falls as the slip rate grows"),
            ("rate_dependent", "mu='0.3+x*V'", r"\.mu = \"0\.3\+x\*V\": x: mu depends on V alone"),
            ("rate_dependent", "mu='0.3+W'", r"\.mu = \"0\.3\+W\": column 5: W is not known"),
            ("static_kinetic", "mu_s=0.2,mu_k=0.3,slip_length=1.0", r"\.mu_s = 0\.2: must not be below mu_k = 0\.3"),
            ("static_kinetic", "mu_s=0.2,mu_k=0.1,slip_length=0.0", r"\.slip_length = 0\.0: must be positive, in met"),
            ("static_kinetic", "mu_s=0.2,mu_k=0.1", r"\.slip_length: missing, it has no default"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1.0,0.0]", r"\.axis = \[1\.0, 0\.0\]: expected a direct"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.0,axis=[1,0,0]", r"\.mu_2 = 0\.0: must be positive"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1,0,0],k_T=1.0", r"\.k_T = 1\.0: .*rigid before slip"),
            ("orthotropic_coulomb", "mu_1=0.2,mu_2=0.1,axis=[1,0,0]", r"\.law = .*: a plane model has one tangential"),
        )
    },
    "law by slip rate without seconds": (
        ["contacts.base.friction={law='rate_dependent',mu=[[0,0.3]]}"],
        r"steps\.seconds = false: contacts\.base\.friction depends on slip rates: say .* seconds = true",
    ),
    "law by slip rate that a method does not know": (
        [
            "contacts.base.friction={law='rate_dependent',mu=[[0,0.3]]}",
            "steps.seconds=true",
            "solver.method=nsgs",
        ],
        r"contacts\.base\.friction\.law = rate_dependent: solver\.method = nsgs has no friction by slip rate; use cond",
    ),
    "slip rate in another expression": (
        ["supports.top.displacement.x='V*t'"],
        r"supports\.top\.displacement\.x = \"V\*t\": V: the slip rate, which friction laws alone depend on",
    ),
    "law by slip that a method does not know": (
        [
            "contacts.base.friction={law='static_kinetic',mu_s=0.3,mu_k=0.2,slip_length=1.0}",
            "solver.method=regularised",
        ],
        r"contacts\.base\.friction\.law = static_kinetic: solver\.method = regularised works with coulomb",
    ),
    "axis of friction along the normal": (
        [
            *SPACE,
            "obstacles.foundation={shape='plane',point=[0.0,0.0,0.0],normal=[0.0,0.0,1.0]}",
            "contacts.base.friction={law='orthotropic_coulomb',mu_1=0.3,mu_2=0.2,axis=[0.0,0.0,1.0]}",
            "supports.top.displacement={x=0.1,y=0.0,z=-0.1}",
            "probes.corner.point=[0.0,0.0,2.0]",
        ],
        r"contacts\.base\.friction\.axis = \[0\.0, 0\.0, 1\.0\]: is normal to the side at some point",
    ),
    "friction of a tied surface": (
        ["contacts.base.normal.law='tied'"],
        r"contacts\.base\.friction: a tied surface sticks, leave it out",
    ),
    "root as compliance": (
        ["contacts.base.normal={law='compliance',c_n=1.0,m_n=0.5}"],
        r"contacts\.base\.normal\.m_n = 0\.5: must be at least 1",
    ),
    "no mesh size": (["geometry.mesh_size=0.0"], r"geometry\.mesh_size = 0\.0: must be positive, in metres"),
    "no normal": (["obstacles.foundation.normal=[0.0,0.0]"], r"foundation\.normal = \[0\.0, 0\.0\]: .*not be zero"),
    "no steps": (["steps.count=0"], r"steps\.count = 0: must be a whole number from 1"),
    "no time": (["steps.end=0.0"], r"steps\.end = 0\.0: must be positive"),
    "time whose square is zero": (["steps.end=1e-300"], r"steps\.end = 1e-300: must be from 1e-100 to 1e\+100 s"),
    "time whose square is infinite": (["steps.end=1e300"], r"steps\.end = 1e\+300: must be from 1e-100 to"),
    "exact answer": (["solver.tolerance=0.0"], r"solver\.tolerance = 0\.0: must lie between 0 and 1"),
    "times that do not increase": (
        ["supports.top.displacement.y=[[1,0],[0.5,-0.1]]"],
        r"supports\.top\.displacement\.y = \[1\.0, 0\.5\]: times must increase",
    ),
    "time before the start": (
        ["supports.top.displacement.y=[[-1,0],[1,-0.1]]"],
        r"supports\.top\.displacement\.y = \[-1\.0, 1\.0\]: times must increase, from 0 or later",
    ),
    "empty table in time": (["supports.top.displacement.y=[]"], r"top\.displacement\.y = \[\]: .*at least one"),
    # number of components
    "point in space": (["obstacles.foundation.point=[0.0,0.0,0.0]"], r"foundation\.point = \[.*\]: expected 2 comp"),
    "traction in space": (
        ["loads.side={boundary='block.left',traction=[1.0,0.0,0.0]}"],
        r"side\.traction.*expected 2 ",
    ),
    "gravity along a line": (
        ["bodies.block.density=1.0", "gravity.acceleration=[-9.81]"],
        r"acceleration = \[-9\.81\]",
    ),
    "probe on a line": (["probes.corner.point=[0.0]"], r"probes\.corner\.point = \[0\.0\]: expected 2 components"),
    "support across the plane": (["supports.top.displacement.z=0.0"], r"displacement\.z: a plane model has x and y"),
    "obstacle across the plane": (
        ["obstacles.foundation.displacement={z=0.0}"],
        r"displacement.*plane model has x and",
    ),
    "width in the plane": (["geometry.width=1.0"], r"geometry\.width = 1\.0: a plane model has no width"),
    "no width in space": (["model='3d'"], r"geometry\.width: missing"),
    # what is missing, or too much
    "no stiffness": (["bodies.block={nu=0.3}"], r"bodies\.block\.E: missing"),
    "no material": (["bodies={}"], r"bodies\.block: missing, this body of the geometry needs E and nu"),
    "no compliance": (["contacts.base.normal={law='compliance'}"], r"contacts\.base\.normal\.c_n: missing"),
    "load of two kinds": (
        ["loads.side={boundary='block.left',traction=[1.0,0.0],pressure=1.0}"],
        r"loads\.side\.traction / pressure: exactly one",
    ),
    "load of no kind": (["loads.side={boundary='block.left'}"], r"loads\.side\.traction / pressure / force: exactly"),
    "support of nothing": (["supports.new={displacement={x=0.0}}"], r"supports\.new\.boundary / point: .*exactly one"),
    "support of two things": (["supports.top.point=[0.0,2.0]"], r"supports\.top\.boundary / point: .*exactly one"),
    "support of no direction": (["supports.top.displacement={}"], r"top\.displacement = \{\}: name at least one"),
    "normal of a point": (
        ["supports.new={point=[0.0,2.0],displacement={normal=0.0}}"],
        r"supports\.new\.displacement\.normal = given: a point has no normal",
    ),
    "spring at no side": (
        ["springs.s={at='block.lft',stiffness=[1.0,0.0]}"],
        r"springs\.s\.at = block\.lft: no such side; did you mean block\.left\?",
    ),
    "spring without a direction": (
        ["springs.s={at='block.left',stiffness=1.0}"],
        r"springs\.s\.direction: missing, a single stiffness needs it",
    ),
    "spring that only pulls, some way": (
        ["springs.s={at='block.left',stiffness=[1.0,0.0],acts='tension'}"],
        r"springs\.s\.direction: missing, a spring that acts in one way needs it, from its other end towards `at`",
    ),
    "remote point at no side": (
        ["remote_points.p={boundary='block.lft',point=[0.0,0.0],coupling='rigid'}"],
        r"remote_points\.p\.boundary = block\.lft: no such side; did you mean block\.left\?",
    ),
    "remote point that is moved and pushed": (
        ["remote_points.p={boundary='block.left',point=[0.0,0.0],coupling='rigid',force.x=1.0,displacement.x=0.0}"],
        r"remote_points\.p\.force\.x: displacement\.x is prescribed too; keep one of the two",
    ),
    "distributing remote point that is moved": (
        ["remote_points.p={boundary='block.left',point=[0.0,0.0],coupling='distributing',rotation.z=0.1}"],
        r"remote_points\.p\.rotation: a distributing coupling takes force and moment; set coupling = rigid",
    ),
    "temperature of a time": (
        ["thermal.block={expansion=1e-5,temperature='20*t'}"],
        r'thermal\.block\.temperature = "20\*t": t: has no place here; give its factor in time as history',
    ),
    "temperature beyond the plane": (
        ["thermal.block={expansion=1e-5,temperature='20*z'}"],
        r'thermal\.block\.temperature = "20\*z": z: a plane model has x and y only',
    ),
    "temperature with two histories": (
        ["thermal.block={expansion=1e-5,temperature=20.0,history=1.0}"],
        r"thermal\.block\.history = given: only of an expression; write the temperature itself in time",
    ),
    "bolt at no side": (
        ["bolts.b={head='block.tp',nut='block.bottom',axis=[0.0,1.0],stiffness=1.0,shortening=0.1}"],
        r"bolts\.b\.head = block\.tp: no such side; did you mean block\.top\?",
    ),
    "bolt with two preloads": (
        ["bolts.b={head='block.top',nut='block.left',axis=[0.0,1.0],stiffness=1.0,shortening=0.1,force=1.0}"],
        r"bolts\.b\.shortening / force: exactly one of the two is needed",
    ),
    "bolt without stiffness": (
        ["bolts.b={head='block.top',nut='block.bottom',axis=[0.0,1.0],stiffness=0.0,shortening=0.1}"],
        r"bolts\.b\.stiffness = 0\.0: must be positive, in N/m",
    ),
    "bolt of one side": (
        ["bolts.b={head='block.top',nut='block.top',axis=[0.0,1.0],stiffness=1.0,shortening=0.1}"],
        r"bolts\.b\.nut = block\.top: a bolt has two different ends",
    ),
    "spring in capitals": (
        ["springs.S={at='block.left',stiffness=[1.0,0.0]}"],
        r"springs\.S: a name is made of a-z, 0-9 and _",
    ),
    "gravity without density": (["gravity.acceleration=[0.0,-9.81]"], r"gravity: no body has a density; set bodies\."),
    "two slave roles": (
        ["contacts.second={surface='block.bottom',against='foundation'}"],
        r"contacts\.second\.surface = block\.bottom: already the slave of contacts\.base",
    ),
    "periodic with itself": (
        ["periodic.sides={boundary='block.left',with='block.left'}"],
        r"periodic\.sides\.with = block\.left: a side cannot be periodic with itself",
    ),
    "periodic with nothing": (["periodic.sides={boundary='block.left'}"], r"periodic\.sides\.with: missing"),
    # round obstacles
    "cylinder without a radius": (
        [foundation("shape='cylinder',point=[2.0,-5.0]")],
        r"foundation\.radius: missing",
    ),
    "cylinder turned inside out": (
        [foundation("shape='cylinder',point=[2.0,-5.0],radius=-5.0")],
        r"foundation\.radius = -5\.0: must be positive, in metres",
    ),
    "text for inside": ([foundation(f"{ROLLER},inside='yes'")], r'foundation\.inside = "yes": expected true or false'),
    "cylinder with an axis in the plane": (
        [foundation(f"{ROLLER},axis=[0.0,0.0,1.0]")],
        r"foundation\.axis = .*stands along z; remove the key",
    ),
    "cylinder without an axis in space": (
        [*SPACE, foundation("shape='cylinder',point=[2.0,0.5,-5.0],radius=5.0")],
        r"foundation\.axis.*missing, the direction of the cylinder's axis",
    ),
    "axis without a direction": (
        [*SPACE, foundation("shape='cylinder',point=[2.0,0.5,-5.0],radius=5.0,axis=[0.0,0.0,0.0]")],
        r"foundation\.axis = .*must not be zero",
    ),
    "sphere in the plane": ([foundation(BALL)], r'foundation\.shape = "sphere": .*use "cylinder"'),
    "sphere with half a centre": ([*SPACE, foundation(BALL)], r"center = \[2\.0, -5\.0\]: expected 3 components"),
    "centre in British": (
        [foundation("shape='sphere',centre=[2.0,-5.0],radius=5.0")],
        r"foundation\.centre: unknown key; did you mean center\?",
    ),
    # obstacles that move
    "rotation without a point": (
        ["obstacles.foundation.rotation={angle=0.1}"],
        r"foundation\.rotation\.point: missing",
    ),
    "rotation without an angle": (
        ["obstacles.foundation.rotation={point=[0.0,0.0]}"],
        r"foundation\.rotation\.angle: missing",
    ),
    "rotation in words": (
        ["obstacles.foundation.rotation={angle='90 degrees',point=[0.0,0.0]}"],
        r'foundation\.rotation\.angle = "90 degrees": expected a number in rad, or a table',
    ),
    "rotation about an axis in the plane": (
        ["obstacles.foundation.rotation={angle=0.1,point=[0.0,0.0],axis=[0.0,0.0,1.0]}"],
        r"foundation\.rotation\.axis = .*a plane model turns about z; remove the key",
    ),
    "force and displacement along one axis": (
        ["obstacles.foundation.force={y=1.0}", "obstacles.foundation.displacement={y=1.0}"],
        r"foundation\.force\.y: displacement\.y is prescribed too; keep one",
    ),
    "one component of a force on an obstacle": (
        ["obstacles.foundation.force=[1.0]"],
        r"foundation\.force = \[1\.0\]: expected a table",
    ),
    "force on an obstacle across the plane": (
        ["obstacles.foundation.force={z=1.0}"],
        r"foundation\.force\.z = given: a plane model has x and y only",
    ),
    "Uzawa for an obstacle that a force drives": (
        ["obstacles.foundation.force={y=1.0}", "solver.method='uzawa'"],
        r"solver\.method = uzawa: cannot move obstacles\.foundation by a force; use condensed-newton",
    ),
    "obstacle that nothing stops": (
        ["obstacles.foundation.force={x=1.0}", "contacts.base={surface='block.bottom',against='foundation'}"],
        r"nothing resists the motion of obstacles\.foundation along x, which a force moves",
    ),
    # order and gap
    "third order": (["geometry.order=3"], r"geometry\.order = 3: .*known: 1, 2"),
    "order in words": (["geometry.order='quadratic'"], r'geometry\.order = "quadratic": .*known: 1, 2'),
    "text for a gap": (["contacts.base.gap_offset='1 mm'"], r'contacts\.base\.gap_offset = "1 mm": expected a number'),
    # axisymmetric models
    "axisymmetric, radial force": (
        [*ROUND, "loads.side={boundary='block.right',force=[1.0,0.0]}"],
        r"loads\.side\.force = \[1\.0, 0\.0\]: a radial force has no resultant; use traction or pressure",
    ),
    "axisymmetric, obstacle that moves across the axis": (
        [*ROUND, "obstacles.foundation.displacement={x=0.1}"],
        r"foundation\.displacement\.x = given: breaks the symmetry",
    ),
    "axisymmetric, obstacle that turns": (
        [*ROUND, "obstacles.foundation.rotation={angle=0.1,point=[0.0,0.0]}"],
        r"foundation\.rotation = given: an axisymmetric model has none",
    ),
    "axisymmetric, ball beside the axis": (
        [*ROUND, foundation("shape='sphere',center=[1.0,-5.0],radius=5.0")],
        r"foundation\.center = \[1\.0, -5\.0\]: must lie on the axis of symmetry",
    ),
    "axisymmetric, shaft across the axis": (
        [*ROUND, foundation("shape='cylinder',point=[0.0,0.0],axis=[1.0,0.0],radius=5.0")],
        r"foundation\.axis = \[1\.0, 0\.0\]: expected \[0\.0, 1\.0\], the axis of symmetry",
    ),
    "axisymmetric, gravity across the axis": (
        [*ROUND, "gravity.acceleration=[1.0,0.0]", "bodies.block.density=1.0"],
        r"gravity\.acceleration = \[1\.0, 0\.0\]: .*along the axis y alone",
    ),
    "axisymmetric, axis pulled off itself": (
        ["model='axisymmetric'"],
        r"axis of symmetry and supports\.top: contradict each other at the point \(0, 2\) at t = 2",
    ),
    "axisymmetric, contact on the axis": (
        [*ROUND, "contacts.base.surface='block.left'"],
        r"contacts\.base\.surface = block\.left: lies on the axis of symmetry and has no area",
    ),
    "axisymmetric, load on the axis": (
        [*ROUND, "loads.side={boundary='block.left',force=[0.0,1.0]}"],
        r"loads\.side\.boundary = block\.left: lies on the axis of symmetry and has no area",
    ),
    # mechanics, known before solving
    "body that nothing holds": (
        ["supports={}", "contacts={}"],
        r"supports: nothing resists the .* of the body; add a support",
    ),
    "body that slides freely": (
        ["supports.top.displacement={y=-0.1}", "contacts.base={surface='block.bottom',against='foundation'}"],
        r"supports: nothing resists the translation along x",
    ),
    "Uzawa for a body held by friction": (
        ["supports.top.displacement={y=-0.1}", "solver.method='uzawa'"],
        r"solver\.method = uzawa: .*held by contact alone; use condensed-newton",
    ),
    # known when meshed
    "contradictory supports": (
        ["supports.new={boundary='block.top',displacement={x=1.0}}"],
        r"supports\.new and supports\.top: contradict each other at the point \(.*, 2\) at t = 1",
    ),
    "contradictory supports, later": (
        ["supports.new={boundary='block.top',displacement={x=[[0,0],[1,0],[2,1]]}}"],
        r"supports\.new and supports\.top: contradict each other at the point \(.*, 2\) at t = 2",
    ),
    "periodic sides that do not match": (
        ["periodic.sides={boundary='block.left',with='block.top'}"],
        r"periodic.* block\.left and block\.top: their meshes do not match",
    ),
    "support beside every vertex": (
        ["supports.new={point=[0.1234,0.777],displacement={x=0.0}}"],
        r"supports\.new\.point = \[0\.1234, 0\.777\]: no mesh vertex there; the nearest is \(0, 1\)",
    ),
    "probe outside": (["probes.corner.point=[10.0,10.0]"], r"probes\.corner\.point = \[10\.0, 10\.0\]: lies outside"),
    # the override itself
    "override without a value": (["solver.method"], r"--set solver\.method: expected KEY=VALUE"),
    "override below a number": (["geometry.length.x=3"], r"--set geometry\.length\.x=3: length is not a table"),
    "two lines in a name": (["solver.method='''a\nb'''"], r"solver\.method = a.b: known: auto"),
}
COARSE = options(["geometry.mesh_size=1.0", "geometry.contact_mesh_size=1.0"])
SEVERAL = ("no width in space", "cylinder without an axis in space", "sphere with half a centre")  # of other tables too


@pytest.mark.parametrize("name", WRONG)
def test_wrong_scene_is_refused_with_one_line_and_nothing_is_written(name: str, call: Call, folder: Path) -> None:
    overrides, pattern = WRONG[name]
    spoken = call("run", "block", "-q", "-o", "out", *COARSE, *options(overrides))
    assert_refused(spoken, pattern, folder, [])
    assert spoken[2].count("\n") == 1 or name in SEVERAL


@pytest.mark.parametrize("name", ["unknown key", "incompressible", "body that nothing holds", "Uzawa for a body held"])
def test_plan_refuses_what_run_refuses(name: str, call: Call, folder: Path) -> None:
    overrides, pattern = next(case for known, case in WRONG.items() if known.startswith(name))
    assert_refused(call("plan", "block", *options(overrides)), pattern, folder, [])


@pytest.mark.parametrize("name", ["unknown key of the solver", "probe outside", "contradictory supports"])
def test_a_process_refuses_as_the_function_does(name: str, spawn: Call, folder: Path) -> None:
    overrides, pattern = WRONG[name]
    spoken = spawn("run", "block", "-q", "-o", "out", *COARSE, *options(overrides))
    assert_refused(spoken, pattern, folder, [])
