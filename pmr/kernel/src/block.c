/* Memory on cache lines, and the block of bytes that a system is made from.

   Bytes 0 to 63: "PMRSYS3\n"; int32 1, by which the order of bytes is seen; int32 number of arrays; int64 bytes in
   all; uint64 checksum of what follows; zeros.  Then 64 bytes for each array: name (40), int32 kind (0: int32, 1:
   double, 2: bytes), int32 zero, int64 count, int64 offset.  Then the arrays, each on a multiple of 64. */
#include "internal.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    char magic[8];
    int32_t order, arrays;
    int64_t bytes;
    uint64_t checksum;
    char zeros[32];
} file_head;

typedef struct {
    char name[40];
    int32_t kind, zero;
    int64_t count, offset;
} array_head;

void pmr_say(char *why, const char *format, ...)
{
    va_list arguments;
    if (!why) return;
    va_start(arguments, format);
    vsnprintf(why, PMR_MESSAGE, format, arguments);
    va_end(arguments);
}

void *pmr_aligned(size_t bytes)
{
    char *all = malloc(bytes + PMR_LINE + sizeof(void *)), *memory;
    if (!all) return NULL;
    memory = all + sizeof(void *);
    memory += (PMR_LINE - (uintptr_t)memory % PMR_LINE) % PMR_LINE;
    memcpy(memory - sizeof(void *), &all, sizeof(void *));
    return memory;
}

void pmr_free_aligned(void *memory)
{
    void *all;
    if (!memory) return;
    memcpy(&all, (char *)memory - sizeof(void *), sizeof(void *));
    free(all);
}

/* FNV-1a over words of eight bytes, the last one filled up with zeros; a rotation lets high bits reach low ones. */
uint64_t pmr_checksum(const void *bytes, size_t count)
{
    const char *at = bytes;
    uint64_t sum = 14695981039346656037u ^ count, word;
    for (; count; at += 8) {
        size_t some = count < 8 ? count : 8;
        word = 0;
        memcpy(&word, at, some);
        sum = (sum ^ word) * 1099511628211u;
        sum = (sum << 29) | (sum >> 35);
        count -= some;
    }
    return sum;
}

static const array_head *heads(const pmr_system *y) { return (const array_head *)(y->block + sizeof(file_head)); }

static const array_head *find_array(const pmr_system *y, const char *name)
{
    const file_head *head = (const file_head *)y->block;
    int32_t k;
    for (k = 0; k < head->arrays; k++)
        if (!strcmp(heads(y)[k].name, name)) return heads(y) + k;
    return NULL;
}

/* The array with a name; NULL, said in `why`, if it is missing or has not `count` entries (less than 0: any number).  One
   without entries may be missing. */
const void *pmr_block_take(const pmr_system *y, const char *name, int kind, int64_t count, char *why)
{
    const array_head *array = find_array(y, name);
    if (!array && !count) return y->block;
    if (!array) return pmr_say(why, "array %s is missing", name), NULL;
    if (array->kind == kind && (count < 0 || array->count == count)) return y->block + array->offset;
    pmr_say(why, "array %s has %lld entries of kind %d", name, (long long)array->count, (int)array->kind);
    return NULL;
}

int64_t pmr_block_count(const pmr_system *y, const char *name)
{
    const array_head *array = find_array(y, name);
    return array ? array->count : 0;
}

static int all_finite(const double *values, int64_t count)
{
    int64_t n;
    for (n = 0; n < count; n++)
        if (!isfinite(values[n])) return 0;
    return 1;
}

int pmr_block_check(const pmr_system *y, char *why)
{
    const file_head *head = (const file_head *)y->block;
    const int64_t first = (int64_t)sizeof(file_head);
    int32_t k;
    if ((uintptr_t)y->block % PMR_LINE) return pmr_say(why, "the block has to begin on a multiple of %d", PMR_LINE), 1;
    if (y->bytes < sizeof *head || memcmp(head->magic, "PMRSYS3\n", 8))
        return pmr_say(why, "no system that this kernel can read (PMRSYS3)"), 1;
    for (k = 0; k < (int32_t)sizeof head->zeros; k++)
        if (head->zeros[k]) return pmr_say(why, "damaged: its head"), 1;
    if (head->order != 1) return pmr_say(why, "written on a machine with another order of bytes"), 1;
    if (head->bytes != (int64_t)y->bytes)
        return pmr_say(why, "cut short: %lld of %lld bytes", (long long)y->bytes, (long long)head->bytes), 1;
    if (head->checksum != pmr_checksum(y->block + first, y->bytes - sizeof *head))
        return pmr_say(why, "damaged: the checksum differs"), 1;
    if (head->arrays < 0 || head->arrays > (head->bytes - first) / (int64_t)sizeof(array_head))
        return pmr_say(why, "damaged: %d arrays", head->arrays), 1;
    for (k = 0; k < head->arrays; k++) {
        const array_head *array = heads(y) + k;
        const int64_t size = array->kind == PMR_INTEGERS  ? 4
                             : array->kind == PMR_NUMBERS ? 8
                                                          : 1,
                      most = head->bytes / size;
        if (array->name[sizeof array->name - 1] || array->kind < PMR_INTEGERS || array->kind > PMR_BYTES ||
            array->count < 0 || array->count > most || array->offset < first || array->offset % PMR_LINE ||
            array->offset > head->bytes - array->count * size)
            return pmr_say(why, "damaged: array %d", (int)k), 1;
    }
    for (k = 0; k < head->arrays; k++) {
        const array_head *array = heads(y) + k;
        if (array->kind == PMR_NUMBERS && !all_finite((const double *)(y->block + array->offset), array->count))
            return pmr_say(why, "array %s holds what is no finite number", array->name), 1;
    }
    return 0;
}

uint64_t pmr_block_checksum(const pmr_system *y) { return ((const file_head *)y->block)->checksum; }
