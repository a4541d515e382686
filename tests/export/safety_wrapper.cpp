// The wrapper of C++: a robot at 1 mm without commands holds its place; limits that are none are said to be none.
#include <cstdio>

#include "foretouch.hpp"

int main()
{
    foretouch::Safety safety, copy;
    foretouch_safety_limits limits = safety.state.limits;
    limits.speed = 0.0;
    std::printf("%d ", safety.set(limits, 1e-3));
    limits.speed = 0.1;
    std::printf("%d ", safety.set(limits, 1e-3));
    foretouch::SafetyInputs in;
    in.position = in.desired = 1e-3;
    in.force = in.silence = 0.0;
    copy = safety;
    const foretouch::SafetyOutputs out = copy.tick(in);
    std::printf("%g %d\n", out.position, static_cast<int>(copy.tick(in).status) + 2);
    return 0;
}
