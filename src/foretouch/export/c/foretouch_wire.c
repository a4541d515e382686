/* Messages to bytes and back: msgpack, read and written by tables of the fields of each message.

   The tables and the functions of each message are in foretouch_messages.inc, which is made from the same classes as
   Python's messages. */

#include "foretouch_wire.h"

/* All that is needed of a library; <string.h> is not there where there is none. */
void *memcpy(void *restrict to, const void *restrict from, size_t size);
void *memset(void *to, int value, size_t size);

/* ---- What msgpack says ---- */

enum type { NIL, FLAG, INTEGER, REAL, TEXT, BYTES, LIST, MAP, EXTENSION };

/* One thing of msgpack: of a list or a map only its beginning, of all else the whole. */
struct item {
    enum type type;
    bool negative;          /* of an INTEGER: then `value` is its two's complement */
    uint64_t value;         /* of a FLAG, an INTEGER, a REAL (its bits), or the size of what has one */
    const uint8_t *content; /* of a TEXT, BYTES or an EXTENSION */
};

struct reader {
    const uint8_t *at;
    size_t left;
};

static bool read_big_endian(struct reader *from, unsigned size, uint64_t *value)
{
    if (from->left < size)
        return false;
    *value = 0;
    for (unsigned k = 0; k < size; k++)
        *value = *value << 8 | from->at[k];
    from->at += size;
    from->left -= size;
    return true;
}

static bool read_content(struct reader *from, enum type type, struct item *item)
{
    item->type = type;
    if (item->value > from->left)
        return false;
    item->content = from->at;
    from->at += item->value;
    from->left -= (size_t)item->value;
    return true;
}

static bool read_sized(struct reader *from, enum type type, unsigned size, struct item *item)
{
    item->type = type;
    if (!read_big_endian(from, size, &item->value))
        return false;
    if (type == EXTENSION)
        item->value += 1; /* its own type, which is of no interest here */
    return type == LIST || type == MAP || read_content(from, type, item);
}

static bool read_integer(struct reader *from, unsigned size, bool with_sign, struct item *item)
{
    item->type = INTEGER;
    if (!read_big_endian(from, size, &item->value))
        return false;
    item->negative = with_sign && item->value >> (8 * size - 1) != 0;
    if (item->negative && size < 8)
        item->value |= UINT64_MAX << 8 * size;
    return true;
}

static bool read_real(struct reader *from, unsigned size, struct item *item)
{
    item->type = REAL;
    if (!read_big_endian(from, size, &item->value))
        return false;
    if (size == 4) {
        uint32_t bits = (uint32_t)item->value;
        float narrow;
        memcpy(&narrow, &bits, sizeof narrow);
        double wide = narrow;
        memcpy(&item->value, &wide, sizeof wide);
    }
    return true;
}

static bool read_item(struct reader *from, struct item *item)
{
    uint64_t code;
    memset(item, 0, sizeof *item);
    if (!read_big_endian(from, 1, &code))
        return false;
    if (code < 0x80 || code >= 0xe0) {
        item->type = INTEGER;
        item->negative = code >= 0xe0;
        item->value = item->negative ? UINT64_MAX << 8 | code : code;
        return true;
    }
    if (code < 0xc0) {
        item->value = code & (code < 0xa0 ? 0x0f : 0x1f);
        item->type = code < 0x90 ? MAP : code < 0xa0 ? LIST : TEXT;
        return item->type != TEXT || read_content(from, TEXT, item);
    }
    switch (code) {
    case 0xc0: item->type = NIL; return true;
    case 0xc2: case 0xc3: item->type = FLAG; item->value = code & 1; return true;
    case 0xc4: case 0xc5: case 0xc6: return read_sized(from, BYTES, 1u << (code - 0xc4), item);
    case 0xc7: case 0xc8: case 0xc9: return read_sized(from, EXTENSION, 1u << (code - 0xc7), item);
    case 0xca: case 0xcb: return read_real(from, 4u << (code - 0xca), item);
    case 0xcc: case 0xcd: case 0xce: case 0xcf: return read_integer(from, 1u << (code - 0xcc), false, item);
    case 0xd0: case 0xd1: case 0xd2: case 0xd3: return read_integer(from, 1u << (code - 0xd0), true, item);
    case 0xd4: case 0xd5: case 0xd6: case 0xd7: case 0xd8:
        item->value = (UINT64_C(1) << (code - 0xd4)) + 1;
        return read_content(from, EXTENSION, item);
    case 0xd9: case 0xda: case 0xdb: return read_sized(from, TEXT, 1u << (code - 0xd9), item);
    case 0xdc: case 0xdd: return read_sized(from, LIST, 2u << (code - 0xdc), item);
    case 0xde: case 0xdf: return read_sized(from, MAP, 2u << (code - 0xde), item);
    default: return false; /* 0xc1, which msgpack never uses */
    }
}

/* Bytes that the character at `at` takes, 0 where it is not UTF-8: overlong, half of a surrogate pair, too large. */
static size_t character_size(const uint8_t *at, size_t left)
{
    uint8_t first = at[0], low = 0x80, high = 0xbf;
    if (first < 0x80)
        return 1;
    size_t size = first < 0xe0 ? 2 : first < 0xf0 ? 3 : 4;
    if (first < 0xc2 || first > 0xf4 || left < size)
        return 0;
    if (first == 0xe0)
        low = 0xa0;
    if (first == 0xed)
        high = 0x9f;
    if (first == 0xf0)
        low = 0x90;
    if (first == 0xf4)
        high = 0x8f;
    if (at[1] < low || at[1] > high)
        return 0;
    for (size_t k = 2; k < size; k++)
        if ((at[k] & 0xc0) != 0x80)
            return 0;
    return size;
}

/* Whether it is UTF-8 with at most so many characters. */
static bool is_text(const uint8_t *bytes, uint64_t size, uint64_t most)
{
    uint64_t characters = 0;
    for (uint64_t at = 0; at < size; characters++) {
        size_t step = character_size(bytes + at, (size_t)(size - at));
        if (step == 0)
            return false;
        at += step;
    }
    return characters <= most;
}

static double as_double(const struct item *item)
{
    double value;
    if (item->type == REAL)
        memcpy(&value, &item->value, sizeof value);
    else
        value = item->negative ? -(double)(~item->value + 1) : (double)item->value;
    return value;
}

static bool read_number(struct reader *from, double *value)
{
    struct item item;
    if (!read_item(from, &item) || (item.type != REAL && item.type != INTEGER))
        return false;
    *value = as_double(&item);
    return true;
}

static bool read_text(struct reader *from, uint64_t most, foretouch_text *text)
{
    struct item item;
    if (!read_item(from, &item) || item.type != TEXT || !is_text(item.content, item.value, most))
        return false;
    text->text = (const char *)item.content;
    text->size = (uint32_t)item.value;
    return true;
}

/* ---- What a message is made of ---- */

enum kind {
    VERSION,      /* FORETOUCH_WIRE_VERSION, which has no place in a struct */
    COUNT,        /* uint64_t, below 2^63 */
    NUMBER,       /* double */
    BOOLEAN,      /* bool */
    STRING,       /* foretouch_text */
    CHOICE,       /* foretouch_text, one of some */
    CONTENT,      /* foretouch_bytes */
    FEW_NUMBERS,  /* double[], with its count beside it */
    MANY_NUMBERS, /* foretouch_numbers */
    STRINGS,      /* foretouch_texts */
    RECORD        /* a struct, with whether there is one beside it */
};

struct field {
    enum kind kind;
    size_t offset;                /* in its struct [bytes] */
    size_t beside;                /* offset of the count or of the flag beside it */
    uint32_t most;                /* characters, bytes or elements */
    uint32_t longest;             /* characters of each of several texts */
    uint64_t missing;             /* what it is where it is left out: a count, a flag, or the bits of a number */
    const struct record *record;  /* of a RECORD */
    const foretouch_text *choices; /* of a CHOICE, `longest` of them */
};

struct record {
    const struct field *fields;
    uint32_t count;
    uint32_t required; /* so many from the first have to be there */
    size_t size;       /* of the struct [bytes] */
};

static void *part(void *message, size_t offset)
{
    return (unsigned char *)message + offset;
}

static const void *part_of(const void *message, size_t offset)
{
    return (const unsigned char *)message + offset;
}

static void set_missing(const struct field *field, void *message)
{
    bool flag = field->missing != 0;
    if (field->kind == COUNT || field->kind == NUMBER)
        memcpy(part(message, field->offset), &field->missing, sizeof field->missing);
    else if (field->kind == BOOLEAN)
        memcpy(part(message, field->offset), &flag, sizeof flag);
}

static void set_all_missing(const struct record *record, void *message)
{
    memset(message, 0, record->size);
    for (uint32_t k = 0; k < record->count; k++)
        set_missing(&record->fields[k], message);
}

/* ---- Reading: into a message, or where that is NULL only to see whether it can be ---- */

static bool is_same(const foretouch_text *one, const foretouch_text *other)
{
    if (one->size != other->size)
        return false;
    for (uint32_t k = 0; k < one->size; k++)
        if (one->text[k] != other->text[k])
            return false;
    return true;
}

static bool is_choice(const struct field *field, const foretouch_text *text)
{
    for (uint32_t k = 0; k < field->longest; k++)
        if (is_same(&field->choices[k], text))
            return true;
    return false;
}

static bool read_list(struct reader *from, uint32_t most, uint32_t *count)
{
    struct item item;
    if (!read_item(from, &item) || item.type != LIST || item.value > most)
        return false;
    *count = (uint32_t)item.value;
    return true;
}

static bool read_few_numbers(struct reader *from, const struct field *field, void *message)
{
    uint32_t count;
    double value;
    if (!read_list(from, field->most, &count))
        return false;
    for (uint32_t k = 0; k < count; k++) {
        if (!read_number(from, &value))
            return false;
        if (message)
            memcpy(part(message, field->offset + k * sizeof value), &value, sizeof value);
    }
    if (message)
        memcpy(part(message, field->beside), &count, sizeof count);
    return true;
}

static bool read_many_numbers(struct reader *from, const struct field *field, void *message)
{
    foretouch_numbers list = {0, NULL, {NULL, 0}};
    double value;
    if (!read_list(from, field->most, &list.count))
        return false;
    list.packed.bytes = from->at;
    for (uint32_t k = 0; k < list.count; k++)
        if (!read_number(from, &value))
            return false;
    list.packed.size = (uint32_t)(from->at - list.packed.bytes);
    if (message)
        memcpy(part(message, field->offset), &list, sizeof list);
    return true;
}

static bool read_strings(struct reader *from, const struct field *field, void *message)
{
    foretouch_texts list = {0, NULL, {NULL, 0}};
    foretouch_text text;
    if (!read_list(from, field->most, &list.count))
        return false;
    list.packed.bytes = from->at;
    for (uint32_t k = 0; k < list.count; k++)
        if (!read_text(from, field->longest, &text))
            return false;
    list.packed.size = (uint32_t)(from->at - list.packed.bytes);
    if (message)
        memcpy(part(message, field->offset), &list, sizeof list);
    return true;
}

static bool read_string(struct reader *from, const struct field *field, void *message)
{
    foretouch_text text;
    if (!read_text(from, field->most, &text) || (field->kind == CHOICE && !is_choice(field, &text)))
        return false;
    if (message)
        memcpy(part(message, field->offset), &text, sizeof text);
    return true;
}

static bool read_plain(struct reader *from, const struct field *field, void *message)
{
    struct item item;
    if (!read_item(from, &item))
        return false;
    if (field->kind == BOOLEAN) {
        bool flag = item.value != 0;
        if (message && item.type == FLAG)
            memcpy(part(message, field->offset), &flag, sizeof flag);
        return item.type == FLAG;
    }
    if (field->kind == CONTENT) {
        foretouch_bytes content = {item.content, (uint32_t)item.value};
        if (message && item.type == BYTES)
            memcpy(part(message, field->offset), &content, sizeof content);
        return item.type == BYTES && item.value <= field->most;
    }
    if (message && field->kind == COUNT)
        memcpy(part(message, field->offset), &item.value, sizeof item.value);
    return item.type == INTEGER && item.value >> 63 == 0 &&
           (field->kind == COUNT || item.value == FORETOUCH_WIRE_VERSION);
}

static bool read_record(struct reader *from, const struct record *record, void *message);

static bool read_optional_record(struct reader *from, const struct field *field, void *message)
{
    bool there = from->left > 0 && *from->at != 0xc0;
    if (message)
        memcpy(part(message, field->beside), &there, sizeof there);
    if (there)
        return read_record(from, field->record, message ? part(message, field->offset) : NULL);
    struct item nil;
    return read_item(from, &nil);
}

static bool read_field(struct reader *from, const struct field *field, void *message)
{
    double value;
    switch (field->kind) {
    case NUMBER:
        if (!read_number(from, &value))
            return false;
        if (message)
            memcpy(part(message, field->offset), &value, sizeof value);
        return true;
    case STRING: case CHOICE: return read_string(from, field, message);
    case FEW_NUMBERS: return read_few_numbers(from, field, message);
    case MANY_NUMBERS: return read_many_numbers(from, field, message);
    case STRINGS: return read_strings(from, field, message);
    case RECORD: return read_optional_record(from, field, message);
    default: return read_plain(from, field, message);
    }
}

static bool read_record(struct reader *from, const struct record *record, void *message)
{
    uint32_t count;
    if (!read_list(from, record->count, &count) || count < record->required)
        return false;
    if (message)
        set_all_missing(record, message);
    for (uint32_t k = 0; k < count; k++)
        if (!read_field(from, &record->fields[k], message))
            return false;
    return true;
}

/* Whether the bytes are a list that begins with another version, whatever follows: all of it as msgpack wants it. */
static bool is_other_version(struct reader from)
{
    struct item item;
    if (!read_item(&from, &item) || item.type != LIST || item.value == 0)
        return false;
    uint64_t missing = item.value; /* things that still have to come, those in lists and maps, too */
    struct reader second = from;
    struct item version;
    if (!read_item(&second, &version) || version.type != INTEGER)
        return false;
    while (missing > 0) {
        if (!read_item(&from, &item))
            return false;
        missing -= 1;
        if (item.type == LIST || item.type == MAP)
            missing += item.type == MAP ? 2 * item.value : item.value;
        if (item.type == TEXT && !is_text(item.content, item.value, item.value))
            return false;
    }
    return from.left == 0 && version.value != FORETOUCH_WIRE_VERSION;
}

static foretouch_status decode(const struct record *record, const uint8_t *bytes, size_t size, void *message)
{
    if (size > FORETOUCH_LARGEST_MESSAGE)
        return FORETOUCH_TOO_LARGE;
    struct reader from = {bytes, size};
    if (!read_record(&from, record, NULL) || from.left > 0)
        return is_other_version((struct reader){bytes, size}) ? FORETOUCH_OTHER_VERSION : FORETOUCH_NO_MESSAGE;
    from = (struct reader){bytes, size};
    return message == NULL || read_record(&from, record, message) ? FORETOUCH_OK : FORETOUCH_NO_MESSAGE;
}

/* ---- Writing: each number in its shortest form, a real one always in 64 bits ---- */

struct writer {
    uint8_t *at;
    size_t left;
    bool full;
};

static void write_bytes(struct writer *to, const void *bytes, size_t size)
{
    to->full = to->full || size > to->left;
    if (to->full || size == 0)
        return;
    memcpy(to->at, bytes, size);
    to->at += size;
    to->left -= size;
}

static void write_coded(struct writer *to, unsigned code, unsigned size, uint64_t value)
{
    uint8_t bytes[9] = {(uint8_t)code};
    for (unsigned k = 0; k < size; k++)
        bytes[1 + k] = (uint8_t)(value >> 8 * (size - 1 - k));
    write_bytes(to, bytes, 1 + size);
}

/* A code and a value in 1, 2, 4 or 8 bytes behind it; the codes for these follow each other from `first`. */
static void write_sized(struct writer *to, unsigned first, uint64_t value)
{
    unsigned power = value < 0x100 ? 0 : value < 0x10000 ? 1 : value <= UINT32_MAX ? 2 : 3;
    write_coded(to, first + power, 1u << power, value);
}

static void write_count(struct writer *to, uint64_t value)
{
    if (value < 0x80)
        write_coded(to, (unsigned)value, 0, 0);
    else
        write_sized(to, 0xcc, value);
}

static void write_number(struct writer *to, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    write_coded(to, 0xcb, 8, bits);
}

static void write_list(struct writer *to, uint32_t count)
{
    if (count < 16)
        write_coded(to, 0x90 | count, 0, 0);
    else if (count < 0x10000)
        write_coded(to, 0xdc, 2, count);
    else
        to->full = true; /* no list of a message is as long */
}

static void write_text(struct writer *to, foretouch_text text)
{
    if (text.size < 32)
        write_coded(to, 0xa0 | text.size, 0, 0);
    else
        write_sized(to, 0xd9, text.size);
    write_bytes(to, text.text, text.size);
}

static void write_numbers(struct writer *to, const double *values, uint32_t count)
{
    write_list(to, count);
    for (uint32_t k = 0; k < count && !to->full; k++)
        write_number(to, values[k]);
}

static void write_many_numbers(struct writer *to, const foretouch_numbers *list)
{
    if (list->values) {
        write_numbers(to, list->values, list->count);
        return;
    }
    struct reader from = {list->packed.bytes, list->packed.size};
    double value = 0.0;
    write_list(to, list->count);
    for (uint32_t k = 0; k < list->count && !to->full; k++) {
        to->full = !read_number(&from, &value);
        write_number(to, value);
    }
}

static void write_strings(struct writer *to, const foretouch_texts *list)
{
    struct reader from = {list->packed.bytes, list->packed.size};
    foretouch_text text = {NULL, 0};
    write_list(to, list->count);
    for (uint32_t k = 0; k < list->count && !to->full; k++) {
        if (list->values)
            text = list->values[k];
        else
            to->full = !read_text(&from, UINT32_MAX, &text);
        write_text(to, text);
    }
}

static void write_content(struct writer *to, const foretouch_bytes *content)
{
    write_sized(to, 0xc4, content->size);
    write_bytes(to, content->bytes, content->size);
}

static void write_record(struct writer *to, const struct record *record, const void *message);

static void write_optional_record(struct writer *to, const struct field *field, const void *message)
{
    bool there;
    memcpy(&there, part_of(message, field->beside), sizeof there);
    if (there)
        write_record(to, field->record, part_of(message, field->offset));
    else
        write_coded(to, 0xc0, 0, 0);
}

static void write_few_numbers(struct writer *to, const struct field *field, const void *message)
{
    uint32_t count;
    memcpy(&count, part_of(message, field->beside), sizeof count);
    to->full = to->full || count > field->most;
    if (!to->full)
        write_numbers(to, part_of(message, field->offset), count);
}

static void write_field(struct writer *to, const struct field *field, const void *message)
{
    const void *value = part_of(message, field->offset);
    switch (field->kind) {
    case VERSION: write_count(to, FORETOUCH_WIRE_VERSION); break;
    case COUNT: write_count(to, *(const uint64_t *)value); break;
    case NUMBER: write_number(to, *(const double *)value); break;
    case BOOLEAN: write_coded(to, *(const bool *)value ? 0xc3 : 0xc2, 0, 0); break;
    case STRING: case CHOICE: write_text(to, *(const foretouch_text *)value); break;
    case CONTENT: write_content(to, value); break;
    case FEW_NUMBERS: write_few_numbers(to, field, message); break;
    case MANY_NUMBERS: write_many_numbers(to, value); break;
    case STRINGS: write_strings(to, value); break;
    case RECORD: write_optional_record(to, field, message); break;
    }
}

static void write_record(struct writer *to, const struct record *record, const void *message)
{
    write_list(to, record->count);
    for (uint32_t k = 0; k < record->count && !to->full; k++)
        write_field(to, &record->fields[k], message);
}

static size_t encode(const struct record *record, const void *message, uint8_t *bytes, size_t room)
{
    struct writer to = {bytes, room, false};
    write_record(&to, record, message);
    size_t size = room - to.left;
    /* What breaks a limit is seen as its receiver would see it. */
    return !to.full && decode(record, bytes, size, NULL) == FORETOUCH_OK ? size : 0;
}

/* ---- What a program calls ---- */

size_t foretouch_numbers_read(const foretouch_numbers *list, double *values, size_t room)
{
    struct reader from = {list->packed.bytes, list->packed.size};
    size_t count = 0;
    for (; count < list->count && count < room; count++) {
        if (list->values)
            values[count] = list->values[count];
        else if (!read_number(&from, &values[count]))
            break;
    }
    return count;
}

size_t foretouch_texts_read(const foretouch_texts *list, foretouch_text *values, size_t room)
{
    struct reader from = {list->packed.bytes, list->packed.size};
    size_t count = 0;
    for (; count < list->count && count < room; count++) {
        if (list->values)
            values[count] = list->values[count];
        else if (!read_text(&from, UINT32_MAX, &values[count]))
            break;
    }
    return count;
}

foretouch_text foretouch_text_of(const char *text)
{
    uint32_t size = 0;
    while (text[size] != '\0')
        size++;
    return (foretouch_text){text, size};
}

#include "foretouch_messages.inc"
