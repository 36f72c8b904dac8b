/* Systems that the instances of a process share: each is read once, and freed with the last instance. */
#include "shared.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#endif

#define FILE_NAME "system.pmr"
enum { LINE = 64, TOKEN = 64 };

struct Shared {
    pmr_system *system;
    void *memory;
    char token[TOKEN];
    int users;
    Shared *next;
};

static Shared *first;

/* Instances may be made by several threads at once. */
#if defined __GNUC__
static char busy;
static void enter(void)
{
    while (__atomic_test_and_set(&busy, __ATOMIC_ACQUIRE)) {
    }
}
static void leave(void) { __atomic_clear(&busy, __ATOMIC_RELEASE); }
#else
static volatile long busy;
static void enter(void)
{
    while (_InterlockedExchange(&busy, 1)) {
    }
}
static void leave(void) { _InterlockedExchange(&busy, 0); }
#endif

static int digit(char letter)
{
    if (letter >= '0' && letter <= '9') return letter - '0';
    letter = (char)(letter | 32);
    return letter >= 'a' && letter <= 'f' ? letter - 'a' + 10 : -1;
}

/* Path of the system's file in a folder, which FMI 2.0 tells by a URI and FMI 3.0 by its path; to be freed. */
static char *file_in(const char *folder)
{
    const int is_uri = !strncmp(folder, "file:", 5);
    char *path = malloc(strlen(folder) + sizeof FILE_NAME + 2), *to = path;
    if (!path) return NULL;
    if (is_uri) {
        folder += 5;
        if (!strncmp(folder, "//", 2)) folder = strchr(folder + 2, '/') ? strchr(folder + 2, '/') : folder + 2;
#ifdef _WIN32
        if (folder[0] == '/') folder++;
#endif
    }
    while (*folder) {
        if (is_uri && folder[0] == '%' && digit(folder[1]) >= 0 && digit(folder[2]) >= 0) {
            *to++ = (char)(16 * digit(folder[1]) + digit(folder[2]));
            folder += 3;
        } else {
            *to++ = *folder++;
        }
    }
    if (to > path && to[-1] != '/' && to[-1] != '\\') *to++ = '/';
    strcpy(to, FILE_NAME);
    return path;
}

static FILE *opened(const char *path)
{
#ifdef _WIN32
    wchar_t wide[4096];
    return MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, 4096) ? _wfopen(wide, L"rb") : NULL;
#else
    return fopen(path, "rb");
#endif
}

/* All of a file, on a multiple of `LINE` in memory that is returned; NULL if it can't be read. */
static void *read_file(const char *path, char **block, size_t *bytes)
{
    FILE *file = opened(path);
    char *memory = NULL;
    long size;
    if (!file) return NULL;
    if (!fseek(file, 0, SEEK_END) && (size = ftell(file)) >= 0 && !fseek(file, 0, SEEK_SET)) {
        memory = malloc((size_t)size + LINE);
        if (memory) {
            *block = memory + (LINE - (uintptr_t)memory % LINE) % LINE;
            *bytes = (size_t)size;
            if (fread(*block, 1, *bytes, file) != *bytes) {
                free(memory);
                memory = NULL;
            }
        }
    }
    fclose(file);
    return memory;
}

static int has_token(const pmr_system *system, const char *token)
{
    size_t count;
    const char *text = pmr_system_names(system, "token", &count);
    return text && strlen(token) == count && !memcmp(text, token, count);
}

/* Why a file is none, without what a log of FMI 2.0 would take for a format. */
static void say_plainly(char *why, size_t room, const char *path, const char *reason)
{
    snprintf(why, room, "resources/" FILE_NAME " (%s): %s", path, reason);
    for (; *why; why++)
        if (*why == '%') *why = '_';
}

static Shared *read_system(const char *token, const char *folder, char *why, size_t room)
{
    Shared *shared = calloc(1, sizeof *shared);
    char *path = folder ? file_in(folder) : NULL, *block = NULL, reason[PMR_MESSAGE] = "it can't be read";
    size_t bytes = 0;
    int failed = 1;
    if (shared && path && (shared->memory = read_file(path, &block, &bytes)))
        failed = pmr_system_open(block, bytes, &shared->system, reason);
    if (failed)
        say_plainly(why, room, path ? path : "no resources", reason);
    else if (!has_token(shared->system, token)) {
        snprintf(why, room, "the token is that of another model");
        failed = 1;
    }
    free(path);
    if (!failed) {
        strncpy(shared->token, token, TOKEN - 1);
        return shared;
    }
    if (shared) {
        pmr_system_close(shared->system);
        free(shared->memory);
        free(shared);
    }
    return NULL;
}

Shared *shared_open(const char *token, const char *folder, char *why, size_t room)
{
    Shared *shared;
    enter();
    for (shared = first; shared && strcmp(shared->token, token); shared = shared->next) {
    }
    if (!shared && (shared = read_system(token, folder, why, room))) {
        shared->next = first;
        first = shared;
    }
    if (shared) shared->users++;
    leave();
    return shared;
}

void shared_close(Shared *shared)
{
    Shared **at = &first;
    if (!shared) return;
    enter();
    if (--shared->users == 0) {
        while (*at != shared) at = &(*at)->next;
        *at = shared->next;
        pmr_system_close(shared->system);
        free(shared->memory);
        free(shared);
    }
    leave();
}

const pmr_system *shared_system(const Shared *shared) { return shared->system; }
