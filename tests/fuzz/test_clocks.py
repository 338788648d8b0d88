"""Laws of rate and state, clocks and initial tractions drawn by lot: stopped runs go on to the same bits."""

from __future__ import annotations

from typing import Any

from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from shared.command import result
from shared.fuzzing import accepted, fuzzed
from shared.histories import Stop, assert_same
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

END = 130.0  # [s]; of the ready slider, behind its first event
BAD = {"a": ["-0.01", "0.0", "'0.01 - x'"], "b": ["-0.1"], "Dc": ["0.0"], "V0": ["0.0"], "damping": ["-1.0"]}


@st.composite
def sliders(draw: st.DrawFn) -> list[str]:
    """Overrides of `spring_slider`: law, clock, what it starts from, and how its top is drawn along."""
    number = {
        "f0": draw(st.sampled_from([0.3, 0.6])),
        "a": draw(st.sampled_from(["0.01", "0.02", "'0.008 + 0.01*x'"])),
        "b": draw(st.sampled_from([0.0, 0.015, "'0.015 + 0*x'"])),
        "Dc": draw(st.sampled_from([1e-5, 2e-5, "'1e-5*(1 + x)'"])),
        "damping": draw(st.sampled_from([0.0, 1e5, 1e7])),
    }
    law = draw(st.sampled_from(["aging", "slip"]))
    friction = ",".join(f"{key}={value}" for key, value in number.items())
    error, every = draw(st.sampled_from([1e-3, 1e-5])), draw(st.sampled_from([9, 25]))
    starts = ["state=10.0", "rate=1e-7", "state='5 + x'", "state='steady'"]
    strengthens = number["b"] == 0.0 or number["a"] == "0.02"  # else low traction is that of boundless steady rates
    start = draw(st.sampled_from(starts if strengthens else starts[:-1]))
    share = draw(st.floats(0.5, 0.99))
    way = draw(st.sampled_from([f"[[0,0],[{END},{END * 1e-6}]]", "[[0,0],[60,6e-5],[70,6e-5],[130,0]]"]))
    return [
        "geometry.mesh_size=1.0",
        f"contacts.base.normal.law='{draw(st.sampled_from(['unilateral', 'bilateral']))}'",
        f"contacts.base.friction={{law='rate_and_state',V0=1e-6,evolution='{law}',{friction}}}",
        f"contacts.base.initial={{pressure=1e6,traction={share * number['f0'] * 1e6},{start}}}",
        f"supports.top.displacement={{x={way},y=0.0}}",
        f"steps={{end={END},clock={{error={error},smallest=1e-9,largest=50.0,every={every}}}}}",
        "output.error=false",
        "output.pictures=false",
    ]


@fuzzed(0.75, least=4)
@given(sliders(), st.integers(1, 5))
def test_a_clock_that_was_stopped_goes_on_to_the_same_bits(tmp_path_factory: Any, words: list[str], after: int) -> None:
    place = tmp_path_factory.mktemp("clock")
    scene = read("spring_slider", words)
    known = accepted(lambda: run(scene, place / "whole"))
    if known is None:
        return
    assert known[0].status == "converged", known[0].sentence
    run(scene, place / "out", Watch(on_step=Stop(after)))
    assert len(result(place / "out")["steps"]) == min(after, len(known[1]["steps"]))
    assert run(scene, place / "out", resume=True)[0].status == "converged"
    assert_same(place / "out", place / "whole")
    energies = [step["energy"] for step in known[1]["steps"]]
    balance = [energy["external"] - energy["stored"] - energy["contact"] for energy in energies]
    assert_allclose(balance, 0.0, atol=1e-9 * max(abs(energy["external"]) for energy in energies))
    assert all(event["start"] < event["end"] <= END for event in known[1].get("events", []))


@fuzzed(1)
@given(st.sampled_from([(key, value) for key, values in BAD.items() for value in values]))
def test_bad_parameters_are_refused_in_a_line(tmp_path_factory: Any, bad: tuple[str, str]) -> None:
    place = tmp_path_factory.mktemp("bad") / "out"
    words = [f"contacts.base.friction.{bad[0]}={bad[1]}", "geometry.mesh_size=1.0"]
    assert accepted(lambda: run(read("spring_slider", words), place)) is None
