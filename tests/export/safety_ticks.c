/* Rows of numbers from the input, through the safety layer, to the output; with "threads", each half in its own. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "foretouch.h"

enum { COLUMNS = 11, RESULTS = 3 };

struct part {
    const double *rows;
    double *results;
    size_t count;
    foretouch_safety state;
};

static void *run(void *given)
{
    struct part *part = given;
    foretouch_safety_init(&part->state);
    if (!foretouch_safety_set(&part->state, 1e-3))
        abort();
    for (size_t k = 0; k < part->count; k++) {
        const double *in = part->rows + k * COLUMNS;
        double *out = part->results + k * RESULTS;
        int64_t status;
        foretouch_safety_keep(&part->state, in[0] != 0.0, in[1], in[2], in[3], in[4] != 0.0, in[5], in[6], in[7] != 0.0,
            in[8] != 0.0, in[9], in[10] != 0.0, &out[0], &status);
        out[1] = (double)status;
        out[2] = foretouch_safety_limit(&part->state);
    }
    return NULL;
}

static void show(const struct part *part)
{
    fwrite(part->results, sizeof(double) * RESULTS, part->count, stdout);
    fwrite(&part->state, sizeof part->state, 1, stdout);
}

int main(int count, char **words)
{
    size_t room = 1 << 20, size = 0, got;
    char *bytes = malloc(room);
    while (bytes && (got = fread(bytes + size, 1, room - size, stdin)) > 0) {
        size += got;
        if (size == room)
            bytes = realloc(bytes, room *= 2);
    }
    size_t rows = size / (sizeof(double) * COLUMNS), parts = count > 1 && !strcmp(words[1], "threads") ? 2 : 1;
    double *results = malloc(sizeof(double) * RESULTS * (rows + 1));
    static struct part all[2];
    pthread_t threads[2];
    if (!bytes || !results)
        return 1;
    for (size_t k = 0; k < parts; k++) {
        size_t first = k * (rows / 2);
        all[k].rows = (const double *)(const void *)bytes + first * COLUMNS;
        all[k].results = results + first * RESULTS;
        all[k].count = k + 1 < parts ? rows / 2 : rows - first;
        if (pthread_create(&threads[k], NULL, run, &all[k]))
            return 1;
    }
    for (size_t k = 0; k < parts; k++)
        pthread_join(threads[k], NULL);
    for (size_t k = 0; k < parts; k++)
        show(&all[k]);
    free(bytes);
    free(results);
    return 0;
}
