"""The struct `Conditions`: conditions of group members, and the order of the groups, as kernels read them."""

import warp as wp


@wp.struct
class Conditions:
    """The conditions of a scene. The draws are the groups of `Program`, and a member is an entry of `group_slot`.

    A term is a set of slots. It holds if at least one of their objects is present or, with `term_holds` 0, if all are
    absent.
    """

    order: wp.array[int]  # all groups, in the order of dependence
    member_leafadr: wp.array[int]  # slots of the member, more than one if it is a group
    member_leafnum: wp.array[int]
    member_termadr: wp.array[int]  # terms that all have to hold
    member_termnum: wp.array[int]
    leaf: wp.array[int]
    term_holds: wp.array[int]  # 1 or 0, as above
    term_slotadr: wp.array[int]
    term_slotnum: wp.array[int]
    term_slot: wp.array[int]
