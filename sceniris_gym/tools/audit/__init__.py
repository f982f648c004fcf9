"""A second opinion on layouts: it judges them from the MjModel alone and imports nothing that makes them.

geometry.py    geoms as solids, and their poses          distance.py   exact distances, containment
pairs.py       which solids must be apart                collisions.py missed collisions, false alarms
supports.py    level surfaces, rays                      standing.py   objects on their supports
outlines.py    objects seen from above                   relations.py  relations between them
turns.py       orientations                              presence.py   groups and who is absent
reach.py       what an arm is said to reach
language.py    those three, counted                      physics.py    penetration and settling in MuJoCo C
auditor.py     all of it, as one report
"""
