/* Systems that the instances of a process share. */
#ifndef SHARED_H
#define SHARED_H

#include "pmr_kernel.h"

typedef struct Shared Shared;

/* The system in a folder of resources whose token is this one; NULL with the reason in `why`. */
Shared *shared_open(const char *token, const char *folder, char *why, size_t room);
void shared_close(Shared *shared);
const pmr_system *shared_system(const Shared *shared);

#endif
