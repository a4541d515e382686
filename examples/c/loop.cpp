// A whole session in one process, in C++ at 1 kHz: a hand holds a simulated device, a leader renders for it, a follower
// presses foam with a simulated robot, and between them is a slow network that delays and loses messages.
//
//     ./loop 10          for 10 s, and says each half second what is felt, and at the end how punctual the loop was
//
// The loop sleeps to just before each tick and waits the rest awake (ticks.h), so that it begins on time.
// In the loop nothing allocates, and no system call is made but those to sleep and, twice a second, to print.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "foretouch.hpp"
#include "ticks.h"

namespace {

constexpr double PERIOD = 1e-3; // [s]

// Numbers from 0 to 1 that only look random: the same in each run.
class Chance {
public:
    double draw()
    {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        return static_cast<double>(state >> 11) * 0x1p-53;
    }

private:
    std::uint64_t state = 0x9e3779b97f4a7c15;
};

// One way of a network: messages of up to so many bytes arrive later, and some never.
template <std::size_t Room, std::size_t Most> class Way {
public:
    void send(foretouch::Bytes message, std::int64_t now)
    {
        if (message.empty() || message.size > Room || chance.draw() < LOST) {
            return;
        }
        Slot &slot = slots[next++ % Most]; // the oldest is written over: it has arrived long ago
        const double delay = DELAY + JITTER * (2.0 * chance.draw() - 1.0);
        slot.due = now + static_cast<std::int64_t>(1e9 * delay);
        slot.size = message.size;
        std::memcpy(slot.bytes, message.data, message.size);
    }

    // Hand on what has arrived.
    template <class Taker> void arrive(std::int64_t now, Taker take)
    {
        for (Slot &slot : slots) {
            if (slot.size > 0 && slot.due <= now) {
                take(foretouch::Bytes{slot.bytes, slot.size});
                slot.size = 0;
            }
        }
    }

private:
    static constexpr double DELAY = 0.08, JITTER = 0.02, LOST = 0.05; // [s], [s], ratio

    struct Slot {
        std::int64_t due = 0;
        std::size_t size = 0;
        std::uint8_t bytes[Room];
    };

    std::array<Slot, Most> slots;
    std::size_t next = 0;
    Chance chance;
};

// A hand of 0.15 kg that aims by a spring of 400 N/m and 8 N s/m, and holds a device of 0.1 kg and 2 N s/m.
class Hand {
public:
    double position = 0.0; // [m]

    // What the device's encoder shows [m].
    double read() const { return 1e-5 * std::round(1e5 * position); }

    // Let a period pass in which the device gives this force [N].
    void go_on(double force)
    {
        time += PERIOD;
        const double aim = intended(time);
        const double aim_velocity = (aim - aimed) / PERIOD;
        aimed = aim;
        const double pulls = 400.0 * (aim - position) + 8.0 * (aim_velocity - velocity) - 2.0 * velocity;
        velocity += PERIOD * (pulls - force) / (0.15 + 0.1);
        position += PERIOD * velocity;
    }

private:
    // Close to the surface in a second, and then it aims 20 mm further in and out again, once in two seconds.
    static double intended(double time)
    {
        const double turn = 6.283185307179586;
        return time < 1.0 ? 0.0035 * (1.0 - std::cos(0.5 * turn * time))
                          : 0.007 + 0.010 * (1.0 - std::cos(0.5 * turn * (time - 1.0)));
    }

    double time = 0.0, velocity = 0.0, aimed = 0.0;
};

// A robot that goes where it is told within some milliseconds, and presses foam 10 mm away: F = d^1.4 (3000 + 1500 v).
class Robot {
public:
    foretouch_sample go_on(double told)
    {
        if (std::isfinite(told)) {
            const double velocity = RATE * (told - position);
            position += PERIOD * velocity;
            const double depth = std::max(position - SURFACE, 0.0);
            force = std::max(std::pow(depth, 1.4) * (3000.0 + 1500.0 * velocity), 0.0);
            commanded = told;
        }
        const double nowhere = std::numeric_limits<double>::quiet_NaN();
        const double noise = 0.06 * (chance.draw() - 0.5);
        return {5e-6 * std::round(2e5 * position), force + noise, 0.0, force, position, commanded, false, nowhere};
    }

private:
    static constexpr double SURFACE = 0.010, RATE = 300.0; // [m], [1/s]

    double position = 0.0, force = 0.0, commanded = 0.0;
    Chance chance;
};

struct Session {
    explicit Session(std::uint64_t number) : leader(number), follower(number)
    {
        follower.state.followers[0].tool_mass = 0.0; // this robot's sensor shows nothing of its tool
    }

    // A tick of both sides, after so many periods of hand and robot: more than one where the machine stood still.
    double tick(const ticks &loop, int periods, std::int64_t computed)
    {
        const std::int64_t now = loop.now, period = loop.period;
        for (int passed = 0; passed < periods; ++passed) {
            hand.go_on(felt);
            sample = robot.go_on(told);
        }
        models.arrive(now, [&](foretouch::Bytes message) { leader.adopt(message); });
        telemetry.arrive(now, [&](foretouch::Bytes message) { leader.hear(message); });
        felt = leader.tick(now, hand.read(), period);
        commands.send(leader.command("loop"), now);

        commands.arrive(now, [&](foretouch::Bytes message) { follower.take(message, now); });
        told = follower.tick(sample, now, period);
        if (follower.model(now, model)) {
            models.send(model, now);
        }
        telemetry.send(follower.telemetry(sample, now, period, computed), now);
        return felt;
    }

    foretouch::Leader leader;
    foretouch::Follower follower;
    foretouch::WrittenModel model;
    Way<FORETOUCH_COMMAND_ROOM, 256> commands;
    Way<FORETOUCH_TELEMETRY_ROOM, 256> telemetry;
    Way<4096, 256> models; // a map of a material has some 1,500 bytes
    Hand hand;
    Robot robot;
    foretouch_sample sample{};
    double felt = 0.0, told = std::numeric_limits<double>::quiet_NaN();
};

} // namespace

int main(int count, char **words)
{
    const int ticks_wanted = 1000 * (count > 1 ? std::atoi(words[1]) : 10);
    static Session session(ticks_process());
    static std::array<std::int64_t, 100'000> late, took;
    std::size_t kept = 0;
    double largest = 0.0, margin = std::numeric_limits<double>::infinity();
    std::printf("   time    hand  felt  robot  status\n     [s]    [mm]   [N]    [N]\n");
    ticks loop = {};
    std::int64_t computed = 0;
    for (int tick = 0, shown = 0; tick < ticks_wanted;) {
        const int periods = ticks_wait(&loop);
        const double felt = session.tick(loop, periods, computed);
        computed = ticks_clock(CLOCK_MONOTONIC) - loop.woke;
        tick += periods;
        if (kept < late.size()) {
            late[kept] = loop.woke - loop.now;
            took[kept++] = computed;
        }
        largest = std::max(largest, felt);
        margin = std::min(margin, session.leader.shown().energy + session.leader.shown().energy_bound);
        if (tick / 500 > shown) {
            shown = tick / 500;
            const foretouch_shown_follower &there = session.follower.shown();
            std::printf("%8.1f  %6.1f  %4.1f  %5.1f  %6d\n", 1e-3 * tick, 1e3 * session.hand.position, felt, there.force,
                static_cast<int>(there.status));
            std::fflush(stdout);
        }
    }
    std::sort(late.begin(), late.begin() + static_cast<std::ptrdiff_t>(kept));
    std::sort(took.begin(), took.begin() + static_cast<std::ptrdiff_t>(kept));
    const auto microseconds = [&](const auto &times, std::size_t place) { return 1e-3 * static_cast<double>(times[place]); };
    std::printf("largest force felt: %.2f N\nleast energy above its bound: %.2e J\n", largest, margin);
    std::printf("a tick begins late by %.1f us (median), %.1f us (99 of 100), and takes %.1f us and %.1f us\n",
        microseconds(late, kept / 2), microseconds(late, kept * 99 / 100), microseconds(took, kept / 2),
        microseconds(took, kept * 99 / 100));
    return 0;
}
