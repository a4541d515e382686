"""Is this machine fit for a session? One finding a check: a verdict, what was found, and the command that mends it.

Nothing of the package that is heavy is imported here: a check that needs it makes it in a process of its own, which may
also crash there.
"""

from foretouch.doctor.examine import examine
from foretouch.doctor.finding import Finding, Verdict, render_findings, worst

__all__ = ["Finding", "Verdict", "examine", "render_findings", "worst"]
