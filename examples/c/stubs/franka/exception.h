// A STUB of libfranka: see robot.h beside it.

#ifndef FRANKA_EXCEPTION_H_STUB
#define FRANKA_EXCEPTION_H_STUB

#include <stdexcept>

namespace franka {

struct Exception : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

} // namespace franka

#endif
