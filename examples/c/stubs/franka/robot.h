// A STUB of libfranka, for the example beside it to be compiled where libfranka is not: the names that the example uses,
// with the meanings that libfranka's documentation gives them, and nothing else. It is not libfranka, and no part of it.
// Its robot is a tip that follows at once, over a spring of 500 N/m 10 mm below where it begins.

#ifndef FRANKA_ROBOT_H_STUB
#define FRANKA_ROBOT_H_STUB

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <string>
#include <thread>

#include <franka/exception.h>

namespace franka {

struct RobotState {
    std::array<double, 16> O_T_EE{};        // measured pose of the tip in the base, column by column [m]
    std::array<double, 16> O_T_EE_c{};      // the commanded one
    std::array<double, 6> O_F_ext_hat_K{};  // estimated external force and torque in the base [N], [N m]
};

class Duration {
public:
    explicit Duration(std::uint64_t milliseconds) noexcept : count(milliseconds) {}
    std::uint64_t toMSec() const noexcept { return count; }

private:
    std::uint64_t count;
};

struct CartesianPose {
    CartesianPose(const std::array<double, 16> &pose) : O_T_EE(pose) {}
    std::array<double, 16> O_T_EE;
    bool motion_finished = false;
};

inline CartesianPose MotionFinished(CartesianPose pose)
{
    pose.motion_finished = true;
    return pose;
}

enum class ControllerMode { kJointImpedance, kCartesianImpedance };

class Robot {
public:
    explicit Robot(const std::string &) {}

    void setCollisionBehavior(const std::array<double, 7> &, const std::array<double, 7> &, const std::array<double, 6> &,
        const std::array<double, 6> &)
    {
    }

    void control(std::function<CartesianPose(const RobotState &, Duration)> callback,
        ControllerMode = ControllerMode::kJointImpedance, bool = true, double = 100.0)
    {
        RobotState state;
        for (std::size_t k = 0; k < 16; k += 5) {
            state.O_T_EE[k] = state.O_T_EE_c[k] = 1.0;
        }
        state.O_T_EE[14] = state.O_T_EE_c[14] = 0.5;
        auto next = std::chrono::steady_clock::now();
        std::uint32_t chance = 1;
        for (bool first = true;; first = false) {
            const CartesianPose wanted = callback(state, Duration(first ? 0 : 1));
            if (wanted.motion_finished) {
                return;
            }
            chance = 1664525 * chance + 1013904223; // the estimate is never quite still
            const double noise = 1e-11 * (static_cast<double>(chance) - 2147483648.0);
            state.O_T_EE = state.O_T_EE_c = wanted.O_T_EE;
            state.O_F_ext_hat_K[2] = -500.0 * std::max(0.49 - wanted.O_T_EE[14], 0.0) + noise;
            next += std::chrono::milliseconds(1);
            std::this_thread::sleep_until(next);
        }
    }
};

} // namespace franka

#endif
