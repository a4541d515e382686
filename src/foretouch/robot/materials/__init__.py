"""Materials that the simulated robot presses: their laws, compiled, and where their numbers come from."""

from foretouch.robot.materials.catalogue import (
    DEFAULT_MATERIAL,
    MATERIALS,
    make_material,
    material_names,
    shipped_foam_fit,
)
from foretouch.robot.materials.contacts import (
    ElasticResponse,
    HystereticContact,
    Layer,
    LayeredContact,
    Relaxation,
    RelaxingContact,
)
from foretouch.robot.materials.foam_fit import FOAM_DATASETS, FoamFit, fit_foam, foam_fit_json
from foretouch.robot.materials.material import DEFAULT_SURFACE, Material
from foretouch.robot.materials.rubbers import AdhesiveSphere, MullinsSphere, TabulatedContact
from foretouch.robot.materials.spheres import PoroelasticSphere, ThinLayer, ViscoelasticSphere

__all__ = [
    "DEFAULT_MATERIAL",
    "DEFAULT_SURFACE",
    "FOAM_DATASETS",
    "MATERIALS",
    "AdhesiveSphere",
    "ElasticResponse",
    "FoamFit",
    "HystereticContact",
    "Layer",
    "LayeredContact",
    "Material",
    "MullinsSphere",
    "PoroelasticSphere",
    "Relaxation",
    "RelaxingContact",
    "TabulatedContact",
    "ThinLayer",
    "ViscoelasticSphere",
    "fit_foam",
    "foam_fit_json",
    "make_material",
    "material_names",
    "shipped_foam_fit",
]
