"""Materials that the simulated robot presses: one file each."""

from foretouch.robot.materials.foam_fit import FOAM_DATASETS, FoamFit, fit_foam, foam_fit_json
from foretouch.robot.materials.foam_measured import shipped_foam_fit
from foretouch.robot.materials.hysteretic_contact import HystereticContact
from foretouch.robot.materials.layered_contact import Layer, LayeredContact
from foretouch.robot.materials.material import DEFAULT_SURFACE, Material
from foretouch.robot.materials.registry import DEFAULT_MATERIAL, MATERIALS, make_material, material_names
from foretouch.robot.materials.relaxing_contact import ElasticResponse, Relaxation, RelaxingContact

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
