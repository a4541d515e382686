// A thread that talks to `foretouch gate`, for a loop that must not: between the two are mailboxes that neither waits for.

#ifndef GATE_THREAD_HPP
#define GATE_THREAD_HPP

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <poll.h>
#include <string>
#include <thread>

#include "foretouch.hpp"
#include "gate.h"

// Messages of at most so many bytes from one thread to one other. What finds no place is left out.
template <std::size_t Room, std::size_t Most> class Mailbox {
public:
    bool put(foretouch_channel channel, foretouch::Bytes message) noexcept
    {
        const std::size_t at = written.load(std::memory_order_relaxed);
        if (message.empty() || message.size > Room || at - read.load(std::memory_order_acquire) == Most) {
            return false;
        }
        Slot &slot = slots[at % Most];
        slot.channel = channel;
        slot.size = message.size;
        std::memcpy(slot.bytes, message.data, message.size);
        written.store(at + 1, std::memory_order_release);
        return true;
    }

    // Hand on all that is there, oldest first.
    template <class Taker> void empty(Taker take)
    {
        std::size_t at = read.load(std::memory_order_relaxed);
        for (; at != written.load(std::memory_order_acquire); ++at) {
            const Slot &slot = slots[at % Most];
            take(slot.channel, foretouch::Bytes{slot.bytes, slot.size});
            read.store(at + 1, std::memory_order_release);
        }
    }

private:
    struct Slot {
        foretouch_channel channel;
        std::size_t size;
        std::uint8_t bytes[Room];
    };

    std::array<Slot, Most> slots{};
    std::atomic<std::size_t> written{0}, read{0};
};

// The gate's end in a thread of its own. The loop uses `take` and `say` alone, which do not wait.
class GateThread {
public:
    GateThread(const std::string &address, std::uint16_t port) : link(std::make_unique<gate>())
    {
        if (gate_open(link.get(), address.c_str(), port)) {
            open = true;
            thread = std::thread([this] { run(); });
        }
    }

    ~GateThread()
    {
        ends = true;
        if (thread.joinable()) {
            thread.join();
        }
        gate_close(link.get());
    }

    GateThread(const GateThread &) = delete;
    GateThread &operator=(const GateThread &) = delete;

    // Whether the connection still stands.
    bool connected() const noexcept { return open; }

    // Hand on what has come since the last call, as take(channel, bytes).
    template <class Taker> void take(Taker taker) { came.empty(taker); }

    // Let a message go out; whether there was room for it.
    bool say(foretouch_channel channel, foretouch::Bytes message) noexcept { return goes.put(channel, message); }

private:
    void run()
    {
        while (!ends && gate_is_open(link.get())) {
            pollfd watched = {link->socket, POLLIN, 0};
            const timespec longest = {0, 250'000}; // what goes out waits for so long [ns]
            ppoll(&watched, 1, &longest, nullptr);
            foretouch_channel channel;
            const std::uint8_t *message;
            std::size_t size;
            while (gate_take(link.get(), &channel, &message, &size)) {
                came.put(channel, {message, size});
            }
            goes.empty([this](foretouch_channel to, foretouch::Bytes one) { gate_send(link.get(), to, one.data, one.size); });
        }
        open = false;
    }

    std::unique_ptr<gate> link;
    Mailbox<4096, 256> came, goes; // a map of a material has some 1,500 bytes
    std::atomic<bool> ends{false}, open{false};
    std::thread thread;
};

#endif
