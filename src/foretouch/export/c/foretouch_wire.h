/* The messages of a session as bytes, and back: what a leader and a follower say to each other.

   Nothing here allocates, keeps anything between calls, or fails in another way than by what it returns. All
   functions may be called from several threads at once, each with messages and bytes of its own. */

#ifndef FORETOUCH_WIRE_H
#define FORETOUCH_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What became of bytes that were to be a message. */
typedef enum {
    FORETOUCH_OK = 0,        /* it is one, and has been read */
    FORETOUCH_NO_MESSAGE,    /* it is none of this kind: cut off, of other types, too long a text, not UTF-8 */
    FORETOUCH_OTHER_VERSION, /* it is one of another version of the schema: install the same on both machines */
    FORETOUCH_TOO_LARGE      /* it has more bytes than FORETOUCH_LARGEST_MESSAGE */
} foretouch_status;

/* A text in UTF-8, without a zero at its end. A decoded one lies in the bytes that the message was read from. */
typedef struct {
    const char *text;
    uint32_t size; /* [bytes] */
} foretouch_text;

/* Bytes. Decoded ones lie in the bytes that the message was read from. */
typedef struct {
    const uint8_t *bytes;
    uint32_t size; /* [bytes] */
} foretouch_bytes;

/* A list of numbers that may be long. To send one, point `values` to them and set `count`. One that was decoded has no
   `values`: it lies packed in the bytes that the message was read from, and `foretouch_numbers_read` unpacks it. */
typedef struct {
    uint32_t count;
    const double *values;   /* of the sender; NULL where they are packed */
    foretouch_bytes packed; /* as they came */
} foretouch_numbers;

/* A list of texts, in the same two forms. */
typedef struct {
    uint32_t count;
    const foretouch_text *values;
    foretouch_bytes packed;
} foretouch_texts;

/* Copy the numbers of a list, `room` at most; how many. */
size_t foretouch_numbers_read(const foretouch_numbers *list, double *values, size_t room);

/* The same of texts; each lies in the bytes that the list came in. */
size_t foretouch_texts_read(const foretouch_texts *list, foretouch_text *values, size_t room);

/* A text of C, which ends with a zero, as one that can be sent. */
foretouch_text foretouch_text_of(const char *text);

/* Of each message NAME below there are

   void foretouch_NAME_init(foretouch_NAME *message);
       Give each field what it has where a sender leaves it out, and 0 or nothing where it may not be left out.

   foretouch_status foretouch_NAME_decode(const uint8_t *bytes, size_t size, foretouch_NAME *message);
       Read a message. Where it is refused, `message` is as it was. Texts, bytes and long lists point into `bytes`,
       which therefore have to stay as long as the message is used.

   size_t foretouch_NAME_encode(const foretouch_NAME *message, uint8_t *bytes, size_t room);
       Write a message, and return its size. 0 where `room` is too small for it, or where no receiver would take it: a
       count above 2^63 - 1, a list or a text longer than its limit, one that is not UTF-8. FORETOUCH_NAME_ROOM bytes
       are enough for any. `bytes` must not be those that the message itself points into. */

#ifdef __cplusplus
}
#endif

#include "foretouch_messages.h"

#endif
