/* The program's end of `foretouch gate`: frames over one TCP connection, on a system with POSIX sockets.

   Nothing here waits or allocates after gate_open. A connection belongs to one thread. */

#ifndef GATE_H
#define GATE_H

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "foretouch_wire.h"

enum { GATE_HEAD = 5, GATE_ROOM = GATE_HEAD + FORETOUCH_LARGEST_MESSAGE, GATE_KERNEL = 65536 };

/* A connection; large, so keep it in static memory. */
typedef struct {
    int socket;               /* -1 where the connection is closed */
    size_t came, taken;       /* bytes in `in`, and those of them that were taken */
    size_t waiting, sent;     /* bytes in `out`, and those of them that were sent */
    uint8_t in[2 * GATE_ROOM];
    uint8_t out[GATE_ROOM];
} gate;

static inline bool gate_is_open(const gate *link)
{
    return link->socket >= 0;
}

static inline void gate_close(gate *link)
{
    if (link->socket >= 0) {
        close(link->socket);
    }
    link->socket = -1;
}

/* Connect to a gate at an address such as 127.0.0.1; whether it answers. */
static inline bool gate_open(gate *link, const char *address, uint16_t port)
{
    struct sockaddr_in at;
    const int yes = 1, room = GATE_KERNEL;
    memset(&at, 0, sizeof at);
    at.sin_family = AF_INET;
    at.sin_port = htons(port);
    link->came = link->taken = link->waiting = link->sent = 0;
    link->socket = inet_pton(AF_INET, address, &at.sin_addr) == 1 ? socket(AF_INET, SOCK_STREAM, 0) : -1;
    if (link->socket < 0) {
        return false;
    }
    /* Small, so that what is read is never much older than what has come. */
    setsockopt(link->socket, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    setsockopt(link->socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    if (connect(link->socket, (const struct sockaddr *)&at, sizeof at) != 0
        || fcntl(link->socket, F_SETFL, fcntl(link->socket, F_GETFL) | O_NONBLOCK) < 0) {
        gate_close(link);
    }
    return gate_is_open(link);
}

/* Send what is left of a frame that the system took in part; whether nothing is left. */
static inline bool gate_go_on(gate *link)
{
    while (gate_is_open(link) && link->sent < link->waiting) {
        const ssize_t sent = send(link->socket, link->out + link->sent, link->waiting - link->sent, MSG_NOSIGNAL);
        if (sent < 0) {
            if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
                gate_close(link);
            }
            return false;
        }
        link->sent += (size_t)sent;
    }
    link->waiting = link->sent = 0;
    return gate_is_open(link);
}

/* Send a message; false where it is left out, because an earlier one is still under way or the connection is closed. */
static inline bool gate_send(gate *link, foretouch_channel channel, const uint8_t *message, size_t size)
{
    if (size == 0 || size > FORETOUCH_LARGEST_MESSAGE || !gate_go_on(link)) {
        return false;
    }
    for (int byte = 0; byte < 4; byte++) {
        link->out[byte] = (uint8_t)((size + 1) >> (8 * byte));
    }
    link->out[4] = (uint8_t)channel;
    memcpy(link->out + GATE_HEAD, message, size);
    link->waiting = GATE_HEAD + size;
    gate_go_on(link);
    return true;
}

/* The next message that has come; false where there is none. It stays until the next call. */
static inline bool gate_take(gate *link, foretouch_channel *channel, const uint8_t **message, size_t *size)
{
    while (gate_is_open(link)) {
        const uint8_t *frame = link->in + link->taken;
        const size_t left = link->came - link->taken;
        if (left >= GATE_HEAD) {
            const size_t length = (size_t)frame[0] | (size_t)frame[1] << 8 | (size_t)frame[2] << 16 | (size_t)frame[3] << 24;
            if (length < 2 || length > 1 + FORETOUCH_LARGEST_MESSAGE) {
                gate_close(link); /* this is no gate */
                return false;
            }
            if (left >= 4 + length) {
                *channel = (foretouch_channel)frame[4];
                *message = frame + GATE_HEAD;
                *size = length - 1;
                link->taken += 4 + length;
                return true;
            }
        }
        memmove(link->in, frame, left);
        link->came = left;
        link->taken = 0;
        const ssize_t came = recv(link->socket, link->in + left, sizeof link->in - left, 0);
        if (came == 0 || (came < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
            gate_close(link);
        }
        if (came <= 0) {
            return false;
        }
        link->came += (size_t)came;
    }
    return false;
}

#endif
