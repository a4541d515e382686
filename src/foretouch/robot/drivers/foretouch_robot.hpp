// A robot's end of foretouch over UDP, in C++17, for POSIX systems. Byte by byte it is described in udp.py.
//
//     foretouch::RobotEnd end(47100, {0.001, 15.0, 1e-6, 0.02, 500.0, 60.0, 4.3, {-0.1, -0.1, -0.05}, {0.1, 0.1, 0.1}});
//     for (;;) {                                       // the robot's own loop paces, here once a millisecond
//         foretouch::At at = ...;                      // as the robot's sensors say
//         const foretouch::Vector aim = end.exchange(at, now_ns);
//         ...                                          // the robot is told to go to `aim`
//     }
//
// `exchange` waits for nothing, allocates nothing and throws nothing. Where the commands cease, `aim` holds still after
// 20 ms; after 100 ms it leads out of the contact, against the force that is felt, and then holds.

#ifndef FORETOUCH_ROBOT_HPP
#define FORETOUCH_ROBOT_HPP

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <stdexcept>

namespace foretouch {

using Vector = std::array<double, 3>;

// What there is to know about the robot. Metres, newtons, seconds, kilograms.
struct Specification {
    double period;              // in which it takes one command: 0.001, 0.002, 0.004 or 0.005
    double force_limit;         // force that it holds in the end, at most
    double encoder_resolution;  // at the tip
    double sensor_noise;        // standard deviation of the force along an axis
    double sensor_bandwidth;    // [Hz]
    double sensor_range;
    double moved_mass;          // that moves with the tip and makes its impacts
    Vector low, high;           // places of the tip that may be commanded, in the base frame
};

enum class Refusal : std::uint32_t { none = 0, protective_stop, emergency_stop, reflex, not_ready, watchdog };

// How the robot is, in its base frame.
struct At {
    Vector place{}, rotation{}, force{}, torque{};
    std::array<float, 8> joints{};  // NaN beyond the last
    Refusal refusal = Refusal::none;
};

namespace detail {

constexpr std::size_t HEAD = 20, HELLO = 20, WHO = 124, GO = 68, AT = 152;

template <typename T>
void put(unsigned char *to, std::size_t &at, T value) {
    static_assert(std::is_trivially_copyable<T>::value, "plain numbers only");
    std::memcpy(to + at, &value, sizeof value);  // little-endian machines only, which `RobotEnd` sees to
    at += sizeof value;
}

template <typename T>
T get(const unsigned char *from, std::size_t at) {
    T value;
    std::memcpy(&value, from + at, sizeof value);
    return value;
}

inline double norm(const Vector &v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

}  // namespace detail

// Where the robot is to go when nobody says so any more.
class Watchdog {
   public:
    static constexpr std::uint64_t HOLDS_NS = 20'000'000, UNLOADS_NS = 100'000'000;
    static constexpr double SPEED = 0.02;   // out of the contact [m/s]
    static constexpr double TOUCHES = 0.5;  // a force below is no contact [N]
    static constexpr double BEYOND = 0.002; // farther out than where it ends [m]

    explicit Watchdog(double period) : step_(SPEED * period) {}

    // A command has come.
    void feed(const Vector &aim, std::uint64_t now_ns) {
        aim_ = aim;
        fed_ns_ = now_ns;
        fed_ = true;
        left_ = BEYOND;
    }

    // Where to go now; the place where the robot is, before the first command.
    Vector aim(const At &at, std::uint64_t now_ns) {
        if (!fed_) return aim_ = at.place;
        if (unloads(now_ns)) {
            const double force = detail::norm(at.force);
            if (force > TOUCHES && std::isfinite(force)) {
                for (std::size_t i = 0; i < 3; ++i) out_[i] = at.force[i] / force;
                left_ = BEYOND;
            }
            if (left_ > 0.0) {
                for (std::size_t i = 0; i < 3; ++i) aim_[i] += step_ * out_[i];
                left_ -= step_;
            }
        }
        return aim_;
    }

    bool unloads(std::uint64_t now_ns) const { return fed_ && now_ns - fed_ns_ > UNLOADS_NS; }

    // The robot stands elsewhere than it was told to, after it has refused.
    void stand(const Vector &place) { aim_ = place; }

   private:
    Vector aim_{}, out_{};
    std::uint64_t fed_ns_ = 0;
    bool fed_ = false;
    double step_, left_ = 0.0;
};

// The robot's end of the connection: one session at a time, the newest that says hello.
class RobotEnd {
   public:
    // Throws std::runtime_error where the port cannot be had.
    RobotEnd(std::uint16_t port, const Specification &own) : own_(own), watchdog_(own.period) {
        const std::uint16_t one = 1;
        if (*reinterpret_cast<const unsigned char *>(&one) != 1) throw std::runtime_error("foretouch: little-endian machines only");
        socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
        sockaddr_in here{};
        here.sin_family = AF_INET;
        here.sin_port = htons(port);
        here.sin_addr.s_addr = htonl(INADDR_ANY);
        if (socket_ < 0 || ::bind(socket_, reinterpret_cast<sockaddr *>(&here), sizeof here) != 0 ||
            ::fcntl(socket_, F_SETFL, O_NONBLOCK) != 0) {
            if (socket_ >= 0) ::close(socket_);
            throw std::runtime_error("foretouch: the UDP port cannot be had");
        }
    }
    RobotEnd(const RobotEnd &) = delete;
    RobotEnd &operator=(const RobotEnd &) = delete;
    ~RobotEnd() { ::close(socket_); }

    // Say how the robot is, once a period; returns where it is to go.
    Vector exchange(At at, std::uint64_t now_ns) {
        listen(now_ns);
        if (at.refusal != Refusal::none) watchdog_.stand(at.place);
        const Vector aim = watchdog_.aim(at, now_ns);
        if (at.refusal == Refusal::none && watchdog_.unloads(now_ns)) at.refusal = Refusal::watchdog;
        if (known_) say(at, now_ns);
        return aim;
    }

    // Whether commands come.
    bool commanded(std::uint64_t now_ns) const { return newest_ > 0 && !watchdog_.unloads(now_ns); }

   private:
    void listen(std::uint64_t now_ns) {
        unsigned char bytes[256];
        for (int i = 0; i < 64; ++i) {
            sockaddr_in from{};
            socklen_t length = sizeof from;
            const ssize_t size = ::recvfrom(socket_, bytes, sizeof bytes, 0, reinterpret_cast<sockaddr *>(&from), &length);
            if (size < 0) return;
            if (static_cast<std::size_t>(size) == detail::HELLO && std::memcmp(bytes, "FTHI", 4) == 0) hello(bytes, from, now_ns);
            if (static_cast<std::size_t>(size) == detail::GO && std::memcmp(bytes, "FTGO", 4) == 0) go(bytes, from, now_ns);
        }
    }

    void hello(const unsigned char *bytes, const sockaddr_in &from, std::uint64_t now_ns) {
        const auto session = detail::get<std::uint32_t>(bytes, 4);
        if (known_ && session != session_ && commanded(now_ns)) return;  // somebody else moves it
        if (!known_ || session != session_) newest_ = said_ = 0;
        known_ = true, session_ = session, peer_ = from;
        unsigned char answer[detail::WHO];
        std::size_t at = head(answer, "FTIS", ++answered_, now_ns);
        for (double value : {own_.period, own_.force_limit, own_.encoder_resolution, own_.sensor_noise,
                             own_.sensor_bandwidth, own_.sensor_range, own_.moved_mass})
            detail::put(answer, at, value);
        for (double value : own_.low) detail::put(answer, at, value);
        for (double value : own_.high) detail::put(answer, at, value);
        send(answer, at);
    }

    void go(const unsigned char *bytes, const sockaddr_in &from, std::uint64_t now_ns) {
        const auto session = detail::get<std::uint32_t>(bytes, 4), sequence = detail::get<std::uint32_t>(bytes, 8);
        if (!known_ || session != session_ || sequence <= newest_ || from.sin_addr.s_addr != peer_.sin_addr.s_addr) return;
        Vector aim{};
        for (std::size_t i = 0; i < 3; ++i) {
            const double value = detail::get<double>(bytes, detail::HEAD + 8 * i);
            if (!std::isfinite(value)) return;
            aim[i] = std::fmin(std::fmax(value, own_.low[i]), own_.high[i]);
        }
        newest_ = sequence;
        watchdog_.feed(aim, now_ns);
    }

    void say(const At &at, std::uint64_t now_ns) {
        unsigned char bytes[detail::AT];
        std::size_t end = head(bytes, "FTAT", ++said_, now_ns);
        for (const Vector *each : {&at.place, &at.rotation, &at.force, &at.torque})
            for (double value : *each) detail::put(bytes, end, value);
        for (float value : at.joints) detail::put(bytes, end, value);
        detail::put(bytes, end, static_cast<std::uint32_t>(at.refusal));
        send(bytes, end);
    }

    std::size_t head(unsigned char *bytes, const char *kind, std::uint32_t sequence, std::uint64_t now_ns) const {
        std::size_t at = 4;
        std::memcpy(bytes, kind, 4);
        detail::put(bytes, at, session_);
        detail::put(bytes, at, sequence);
        detail::put(bytes, at, now_ns);
        return at;
    }

    void send(const unsigned char *bytes, std::size_t size) const {
        (void)::sendto(socket_, bytes, size, 0, reinterpret_cast<const sockaddr *>(&peer_), sizeof peer_);
    }

    Specification own_;
    Watchdog watchdog_;
    int socket_ = -1;
    sockaddr_in peer_{};
    std::uint32_t session_ = 0, newest_ = 0, said_ = 0, answered_ = 0;
    bool known_ = false;
};

}  // namespace foretouch

#endif
