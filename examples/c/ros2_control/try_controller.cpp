// Calls the controller beside it as a controller manager would, at 1 kHz, over a joint that follows at once and a spring
// of 500 N/m 10 mm in: with the stubs, for a test. With ROS 2 the controller manager does this.
//
//     ./try_controller 127.0.0.1 7461 10

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "follower_controller.cpp"

int main(int count, char **words)
{
    const int wanted = 1000 * (count > 3 ? std::atoi(words[3]) : 10);
    double told = 0.0, position = 0.0, force = 0.0, largest = 0.0;
    foretouch_example::FollowerController controller;
    controller.given = {{"gate", count > 1 ? words[1] : "127.0.0.1"}, {"port", count > 2 ? words[2] : "7461"}};
    controller.on_init();
    controller.lend({hardware_interface::LoanedCommandInterface(&told)},
        {hardware_interface::LoanedStateInterface(&position), hardware_interface::LoanedStateInterface(&force)});
    if (controller.on_activate({}) != controller_interface::CallbackReturn::SUCCESS) {
        std::fprintf(stderr, "try_controller: no gate at %s:%s\n", words[1], words[2]);
        return 1;
    }
    std::uint32_t chance = 1;
    auto next = std::chrono::steady_clock::now();
    for (int tick = 0; tick < wanted; ++tick) {
        controller.update(rclcpp::Time(1'000'000 * tick), rclcpp::Duration(1'000'000));
        chance = 1664525 * chance + 1013904223;
        position = told;
        force = 500.0 * std::max(position - 0.010, 0.0) + 1e-11 * (static_cast<double>(chance) - 2147483648.0);
        largest = std::max(largest, force);
        next += std::chrono::milliseconds(1);
        std::this_thread::sleep_until(next);
    }
    controller.on_deactivate({});
    std::printf("largest force: %.2f N, at the end: %.2f N\n", largest, force);
    return 0;
}
