"""The named settings of the study of Ding and Fan (2015).

gplvm                                no surface               Lawrence 2005
gpdm                                 no surface, dynamics     Wang, Fleet and Hertzmann 2006
ll_gpdm                              circle, dynamics         Urtasun et al. 2008
torus1                               torus of one layer       the JGPM of Zhang and Fan 2011
torus3, cylinder3                    of three layers          Ding and Fan 2015
on_torus1, on_torus3, on_cylinder3   the same, points on the surface
"""

from .program import GaitPose
from .settings import Cylinder, NoSurface, OnCylinder, OnTorus, PathDynamics, PoseCircle, Torus

SCALES = (0.4, 1.0, 1.25)
VARIANTS: dict[str, GaitPose] = {
    "gplvm": GaitPose(NoSurface()),
    "gpdm": GaitPose(NoSurface(), dynamics=PathDynamics()),
    "ll_gpdm": GaitPose(PoseCircle(), dynamics=PathDynamics()),
    "torus1": GaitPose(Torus()),
    "torus3": GaitPose(Torus(), SCALES),
    "cylinder3": GaitPose(Cylinder(), SCALES),
    "on_torus1": GaitPose(OnTorus()),
    "on_torus3": GaitPose(OnTorus(), SCALES),
    "on_cylinder3": GaitPose(OnCylinder(), SCALES),
}
