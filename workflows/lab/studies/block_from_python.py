"""The ready scene `block` from Python: built, solved, its contact pressure [Pa] drawn after each step along x [m]."""

import matplotlib.pyplot as plt

import stickslip as s

if __name__ == "__main__":
    scene = s.Scene(
        model="plane strain",
        geometry=s.Block(length=4.0, height=2.0, mesh_size=0.1, contact_mesh_size=0.05),
        bodies={"block": s.Material(E=1.0, nu=0.3)},
        obstacles={"foundation": s.Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
        contacts={"base": s.Contact(surface="block.bottom", against="foundation", friction=s.Coulomb(mu=0.3))},
        supports={"top": s.Support(boundary="block.top", displacement={"x": ((1, 0), (2, 0.05)), "y": ((1, -0.1),)})},
        steps=s.Steps(end=2.0, count=2),
    )
    simulation = s.prepare(scene)
    for step in simulation.steps():
        plt.plot(simulation.data.surfaces["base"][0][:, 0], step.contacts["base"].pressure, ".")
    plt.savefig("pressure.png")
