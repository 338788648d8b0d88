"""A history that depends on the results: a pressed block is pushed until all of it slips, then back until it slips."""

import stickslip

if __name__ == "__main__":
    scene = stickslip.read("block", ["supports.top.displacement={x=0.0,y=[[0,0],[1,-0.05]]}"])
    simulation = stickslip.prepare(scene)  # the bodies are factorised here, once
    script = simulation.script()
    step = script.step(to=1.0)  # pressed, as the scene says
    x, turns = 0.0, []
    for push in (0.005, -0.005):  # [m] a step
        base = step.contacts["base"]
        while base.stick_area > 0 or base.force[0] * push > 0:  # until friction acts against the push everywhere
            x += push
            step = script.step(to=script.time + 1.0, supports={"top": {"x": x}})
            base = step.contacts["base"]
        edge = base.pressure[simulation.data.surfaces["base"][0][:, 0].argmin()]
        print(f"x = {x:+.3f} m: T / N = {base.tangential_force / base.normal_force:.3f}, left edge {edge:.3f} Pa")
        turns.append(step)
    stickslip.run(script.scene, "results/shear")  # once more, for ParaView, tables and pictures
