"""Which features belong to which limb, read off the skeleton's tree."""

from ..motion.features import Layout
from ..motion.skeleton import Skeleton


def limbs(skeleton: Skeleton, layout: Layout) -> dict[str, tuple[str, ...]]:
    """Divide the joints with features into chains from one fork of the tree to the next.

    A limb is called after its first joint; the root is in none. On a CMU skeleton these
    are both legs, the back, both arms, and neck and head.
    """
    described = {*layout.maps, *(label.split("/")[0] for label in layout.angles)}
    above = {name: _above(skeleton, name, described) for name in described}
    root = skeleton.joints[0].name
    below = {name: [n for n in skeleton.names if above.get(n) == name] for name in described}
    found: dict[str, tuple[str, ...]] = {}
    for name in skeleton.names:
        parent = above.get(name)
        if name not in described or name == root or parent is None:
            continue
        if parent == root or len(below[parent]) > 1:
            chain = [name]
            while len(below[chain[-1]]) == 1:
                chain += below[chain[-1]]
            found[name] = tuple(chain)
    return found


def limb_features(layout: Layout, joints: tuple[str, ...]) -> list[int]:
    """Give the places of all features of some joints, angles and velocities."""
    return [i for i, label in enumerate(layout.labels) if label.split("/")[0] in joints]


def _above(skeleton: Skeleton, name: str, described: set[str]) -> str | None:
    """Give the nearest joint above one that has features."""
    joint = skeleton.joints[skeleton.index(name)]
    while joint.parent >= 0:
        joint = skeleton.joints[joint.parent]
        if joint.name in described:
            return joint.name
    return None
