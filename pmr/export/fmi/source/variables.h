/* Variables by their value references, as both versions of the interface read and write them. */
#ifndef VARIABLES_H
#define VARIABLES_H

#include "body.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

/* All return 0, or 1 with the reason in the body's `message`. */
int get_variables(Body *body, const unsigned *references, size_t count, double *values);
int set_variables(Body *body, const unsigned *references, size_t count, const double *values);
int get_states(Body *body, double *states, size_t count);
int set_states(Body *body, const double *states, size_t count);
int get_derivatives(Body *body, double *derivatives, size_t count);
int set_time(Body *body, double time);
int differentiate(Body *body, const unsigned *unknowns, size_t unknown_count, const unsigned *knowns,
                  size_t known_count, const double *seed, double *answer);
int finish_initialisation(Body *body);

/* What is remembered, in memory of its own; NULL where there is none. */
Memory *saved(const Body *body);
void restore(Body *body, const Memory *memory);

/* The same as bytes: a tag that names the model, and what it remembers. */
size_t serialized_size(void);
int serialize(Body *body, const Memory *memory, void *bytes, size_t size);
Memory *deserialized(Body *body, const void *bytes, size_t size);

/* The same text?  NULL is none. */
int same_text(const char *a, const char *b);

#endif
