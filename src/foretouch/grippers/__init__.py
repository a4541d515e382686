"""Two small grippers, of one servo each: one presses far away, and the other is a trigger under the operator's finger.

The cheapest machines on which contact can be felt. Written after the maker's manuals, and tested with the maker's
library against a bus of ours that speaks its protocol with the bus's own timing: **it has not been tried on a servo**.
`docs/grippers.md` says what to do at a first try.
"""

from foretouch.grippers.gripper import Gripper, make_gripper
from foretouch.grippers.handle import GripperHandle, Trigger, felt_over_bus, make_handle
from foretouch.grippers.servo import Servo, ServoState

__all__ = ["Gripper", "GripperHandle", "Servo", "ServoState", "Trigger", "felt_over_bus", "make_gripper", "make_handle"]
