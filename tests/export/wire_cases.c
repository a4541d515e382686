/* Reads cases from the standard input and says what the codec makes of each.

   A case is its size (32 bits, of this machine), the number of its kind (one byte), and its bytes. An answer is the
   status (one byte) and, where that is FORETOUCH_OK, a size and the message encoded again, a size and its fields.
   Each case lies in memory of exactly its size, so that a sanitizer sees one byte too many. */

#include "foretouch_wire.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint8_t said[1 << 22];
static size_t said_size;

static void must(bool good, const char *what)
{
    if (!good) {
        fprintf(stderr, "wire_cases: %s\n", what);
        exit(3);
    }
}

static void say(const void *bytes, size_t size)
{
    must(said_size + size <= sizeof said, "too much to say");
    if (size > 0)
        memcpy(said + said_size, bytes, size);
    said_size += size;
}

static void say_count(uint64_t value) { say(&value, sizeof value); }
static void say_number(double value) { say(&value, sizeof value); }

static void say_bytes(const void *bytes, uint32_t size)
{
    say_count(size);
    say(bytes, size);
}

static double numbers[3][4096];
static foretouch_text texts[2][128];
static unsigned lists;

/* Say a list and let it stand as a sender's would, so that it is encoded from there the next time. */
static void say_numbers(foretouch_numbers *list)
{
    double *values = numbers[lists++ % 3];
    must(foretouch_numbers_read(list, values, 4096) == list->count, "a list of numbers cannot be read");
    must(list->count == 0 || foretouch_numbers_read(list, values, list->count - 1) == list->count - 1, "too many");
    say_count(list->count);
    say(values, list->count * sizeof *values);
    list->values = values;
}

static void say_texts(foretouch_texts *list)
{
    foretouch_text *values = texts[lists++ % 2];
    must(foretouch_texts_read(list, values, 128) == list->count, "a list of texts cannot be read");
    say_count(list->count);
    for (uint32_t k = 0; k < list->count; k++)
        say_bytes(values[k].text, values[k].size);
    list->values = values;
}

static void write_out(const void *bytes, size_t size)
{
    must(fwrite(bytes, 1, size, stdout) == size, "cannot write");
}

static uint8_t *exactly(size_t size)
{
    uint8_t *bytes = malloc(size > 0 ? size : 1);
    must(bytes != NULL, "no memory");
    return bytes;
}

#define TRY(NAME, LARGE)                                                                                               \
    static void say_##NAME(foretouch_##NAME *message);                                                                 \
    static void try_##NAME(const uint8_t *bytes, size_t size)                                                          \
    {                                                                                                                  \
        static uint8_t most[FORETOUCH_LARGEST_MESSAGE];                                                                \
        foretouch_##NAME message, before;                                                                              \
        memset(&message, 0xa5, sizeof message);                                                                        \
        memcpy(&before, &message, sizeof message);                                                                     \
        foretouch_status status = foretouch_##NAME##_decode(bytes, size, &message);                                    \
        write_out(&(uint8_t){(uint8_t)status}, 1);                                                                     \
        must(status == FORETOUCH_OK || memcmp(&before, &message, sizeof message) == 0, "refused and yet written");     \
        if (status != FORETOUCH_OK)                                                                                    \
            return;                                                                                                    \
        size_t again = foretouch_##NAME##_encode(&message, most, sizeof most);                                         \
        must(again <= FORETOUCH_##LARGE##_ROOM, "more than any can be");                                               \
        uint8_t *exact = exactly(again);                                                                               \
        must(foretouch_##NAME##_encode(&message, exact, again) == again, "does not fit what it needs");                \
        must(again == 0 || foretouch_##NAME##_encode(&message, exact, again - 1) == 0, "fits less than it needs");     \
        said_size = 0;                                                                                                 \
        say_##NAME(&message);                                                                                          \
        must(foretouch_##NAME##_encode(&message, exact, again) == again, "lists of a sender's");                       \
        must(memcmp(exact, most, again) == 0, "lists of a sender's are written differently");                          \
        free(exact);                                                                                                   \
        uint32_t sizes[2] = {(uint32_t)again, (uint32_t)said_size};                                                    \
        write_out(sizes, sizeof sizes);                                                                                \
        write_out(most, again);                                                                                        \
        write_out(said, said_size);                                                                                    \
    }

#include "wire_fields.inc"

int main(void)
{
    uint32_t size;
    uint8_t kind;
    while (fread(&size, sizeof size, 1, stdin) == 1) {
        must(fread(&kind, 1, 1, stdin) == 1 && kind < sizeof tries / sizeof *tries, "no such kind");
        uint8_t *bytes = exactly(size);
        must(fread(bytes, 1, size, stdin) == size, "a case is cut off");
        tries[kind](bytes, size);
        free(bytes);
    }
    return 0;
}
