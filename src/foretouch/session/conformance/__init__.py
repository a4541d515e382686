"""What every robot, device, material and estimator keeps to, as checks that an author runs: `foretouch plugins check`.

They stand here because they need a session's sample period and settings, and everything that they check.
"""

from foretouch.session.conformance.arm_checks import link_of
from foretouch.session.conformance.catalogue import BUILT_IN, Entry, catalogue, check_named
from foretouch.session.conformance.device_checks import check_device
from foretouch.session.conformance.estimator_checks import check_estimator
from foretouch.session.conformance.finding import Finding, failed
from foretouch.session.conformance.material_checks import check_material
from foretouch.session.conformance.robot_checks import check_robot

__all__ = [
    "BUILT_IN",
    "Entry",
    "Finding",
    "catalogue",
    "check_device",
    "check_estimator",
    "check_material",
    "check_named",
    "check_robot",
    "failed",
    "link_of",
]
