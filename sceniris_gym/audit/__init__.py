"""The audit of layouts. It needs only the MjModel and the scene file, and shares no code with the generator.

scene.py         the scene, and objects from above       geometry.py      geoms as solids, and their poses
distance.py      exact distances, containment            collisions.py    pairs too near, false alarms
standing.py      objects on their supports, heaps        supports.py      level surfaces, rays
relations.py     relations and orientations, counts      contacts.py      penetration in MuJoCo C
physics.py       rest and equalities in MuJoCo C         chain.py         the arm's kinematics
reach.py         objects that an arm reaches or holds, and objects at markers
auditor.py       one report of all checks except reach and equalities, and groups
"""
