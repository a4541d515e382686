"""Human hand: skin, fat and muscle of the thenar over bone."""

from __future__ import annotations

from foretouch.robot.materials.layered_contact import LayeredContact
from foretouch.robot.materials.material import Material

__all__ = ["hand"]

SKIN = (0.0015, 75.0, 0.60, 0.19)
FAT = (0.0030, 5.0, 0.50, 1.0)
MUSCLE = (0.0100, 20.0, 0.50, 0.15)
BONE_STIFFNESS = 1e6  # [N/m]


def hand() -> Material:
    """The thenar of a relaxed hand, pressed up to 15 N: skin, fat and muscle, and bone beneath.

    - Stiffening: the tangent moduli that Isogai et al. measured in vivo (gluteal region, slow) grow from 26 kPa at 1 N
      to 2,199 kPa at 30 N in subcutaneous fat, and from 62 kPa at 5 N to 440 kPa at 30 N in muscle. The law's factor,
      pressed slowly (1 + F / (p - g p))^2, gives both ratios with p - g p = 2.5 N and 10 N. Skin is much stiffer:
      30 N, by order of magnitude.
    - Thicknesses: 1.5, 3 and 10 mm, by order of magnitude for a thenar.
    - Shares: one half of fat and muscle, so that a quick press meets about twice the force of a slow one at the same
      depth; Spartacus et al. found 2 to 2.75 times in vivo on the palm. Skin 0.6; Wang et al. (mouse): 0.72 +- 0.13.
    - Times: skin 0.19 s (Wang et al.: 0.19 +- 0.10 s); muscle 0.15 s and fat 1 s (Zheng and Mak, soft tissue of the
      lower limb: 0.05 to 8.93 s).
    - Bone: 1,000 N/mm, by order of magnitude: stiff, and no more than what carries it.

    Stiffness at 15 N: between 0.7 and 75 N/mm. The lower end is the modulus of muscle at 5 N (Isogai et al.), under a
    tip of 6 mm radius over 10 mm; the upper end is the spring constant of hand and fingers in ISO/TS 15066, for larger
    contacts and forces.
    """
    return Material(
        name="hand",
        description="human hand: skin, fat and muscle of the thenar over bone, to 15 N",
        provenance="Isogai et al. (2022), J. Phys. Ther. Sci. 34, 777-783 (stiffening); Spartacus et al. (2021), PLoS "
        "ONE 16, e0261008, Wang et al. (2015), PLoS ONE 10, e0120897, Zheng and Mak (1999), J. Biomech. Eng. 121, 330 "
        "(relaxation); thicknesses, skin's stiffness and bone chosen by order of magnitude",
        model=LayeredContact(layers=(SKIN, FAT, MUSCLE), base_stiffness=BONE_STIFFNESS),
        press_depth=0.007,
    )
