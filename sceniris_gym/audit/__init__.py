"""The audit of layouts. It judges them from the MjModel and the scene file alone, and imports nothing that makes them.

scene.py         the scene, and objects from above       geometry.py      geoms as solids, and their poses
distance.py      exact distances, containment            collisions.py    pairs too near, false alarms
starts.py        objects held, objects at markers        supports.py      level surfaces, rays
standing.py      objects on their supports, heaps        relations.py     relations and orientations, counts
physics.py       rest and equalities in MuJoCo C         contacts.py      penetration in MuJoCo C
reach.py         claims that an arm reaches an object    chain.py         the arm's kinematics
auditor.py       all but reach and equalities, as one report, and groups
"""
