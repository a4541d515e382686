"""Materials that the simulated robot presses: their laws, compiled, and where their numbers come from."""

from foretouch.robot.materials.catalogue import (
    DEFAULT_MATERIAL,
    DEFAULT_SURFACE,
    MATERIALS,
    Material,
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

__all__ = [
    "DEFAULT_MATERIAL",
    "DEFAULT_SURFACE",
    "FOAM_DATASETS",
    "MATERIALS",
    "ElasticResponse",
    "FoamFit",
    "HystereticContact",
    "Layer",
    "LayeredContact",
    "Material",
    "Relaxation",
    "RelaxingContact",
    "fit_foam",
    "foam_fit_json",
    "make_material",
    "material_names",
    "shipped_foam_fit",
]
