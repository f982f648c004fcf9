"""The audit of layouts. It needs only the MjModel and the scene file, and shares no code with the generator.

scene.py         the scene, and outlines of objects      geometry.py      geoms as solids, and their poses
distance.py      exact distances, containment            collisions.py    missed collisions, false alarms
standing.py      objects on their supports, heaps        supports.py      level surfaces of bodies
relations.py     relations, orientations, counts         contacts.py      penetration in MuJoCo C
physics.py       rest and equalities in MuJoCo C         chain.py         the arm's kinematics
reach.py         reachable objects, and starts of layouts (objects held by a gripper or at a marker)
auditor.py       checks of groups, and one report of all checks except reach and equalities
"""
