// A robot for foretouch over UDP: here a simulated one, 1,000 times a second, over a floor of 1,000 N/m.
//
//     g++ -std=c++17 -O2 -I "$(python -c 'import foretouch.robot.drivers as d; print(d.__path__[0])')" robot.cpp -o robot
//     ./robot 47100 &
//     foretouch teleop --robot udp@127.0.0.1:47100
//
// For a real one, put its sensors in place of `at`, and its controller where `place` follows `aim`.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "foretouch_robot.hpp"

namespace {

constexpr double PERIOD = 0.001, STIFFNESS = 1000.0, FOLLOWS = 100.0;  // [s], [N/m], [1/s]

std::uint64_t now_ns() {
    using namespace std::chrono;
    return static_cast<std::uint64_t>(duration_cast<nanoseconds>(steady_clock::now().time_since_epoch()).count());
}

}  // namespace

int main(int count, char **arguments) {
    const auto port = static_cast<std::uint16_t>(count > 1 ? std::atoi(arguments[1]) : 47100);
    const double longest = count > 2 ? std::atof(arguments[2]) : 3600.0;  // [s]
    foretouch::RobotEnd end(port, {PERIOD, 15.0, 1e-6, 0.02, 500.0, 60.0, 0.4, {-0.1, -0.1, -0.03}, {0.1, 0.1, 0.1}});
    foretouch::At at;
    at.place = {0.0, 0.0, 0.01};  // 10 mm above the floor
    at.joints.fill(std::numeric_limits<float>::quiet_NaN());
    const auto begin = std::chrono::steady_clock::now();
    auto next = begin;
    bool before = false;
    while (next - begin < std::chrono::duration<double>(longest)) {
        at.force = {0.0, 0.0, std::fmax(-STIFFNESS * at.place[2], 0.0)};
        const foretouch::Vector aim = end.exchange(at, now_ns());
        for (std::size_t i = 0; i < 3; ++i) at.place[i] += FOLLOWS * PERIOD * (aim[i] - at.place[i]);
        if (end.commanded(now_ns()) != before) {
            before = !before;
            std::printf(before ? "commands come\n" : "no commands: unloads at z = %.2f mm, %.2f N\n", 1e3 * at.place[2], at.force[2]);
            std::fflush(stdout);
        }
        next += std::chrono::microseconds(1000);
        std::this_thread::sleep_until(next);
    }
    std::printf("ends at z = %.2f mm, %.2f N\n", 1e3 * at.place[2], at.force[2]);
}
