/* Counts what a rank sends to others: loaded before the MPI library, it stands between the caller and MPI.

   A message is what goes to one other rank; of a collective call each rank counts what it contributes.  Persistent
   requests count when they start.  Fortran's calls (MUMPS) are counted where they reach more than one rank. */
#include <mpi.h>

enum { MESSAGES, MESSAGE_BYTES, COLLECTIVES, COLLECTIVE_BYTES, FORTRAN, KINDS };
static long long counted[KINDS];

void pmr_messages(long long out[KINDS]) {
    for (int k = 0; k < KINDS; k++) out[k] = counted[k];
}

static int ranks(MPI_Comm comm) {
    int inter = 0, size = 1;
    PMPI_Comm_test_inter(comm, &inter);
    if (inter) PMPI_Comm_remote_size(comm, &size); else PMPI_Comm_size(comm, &size);
    return size;
}

static int own(MPI_Comm comm) {
    int rank;
    PMPI_Comm_rank(comm, &rank);
    return rank;
}

static long long bytes(int count, MPI_Datatype type) {
    int size;
    PMPI_Type_size(type, &size);
    return (long long)count * size;
}

static void send(int count, MPI_Datatype type, int to, MPI_Comm comm) {
    if (to == MPI_PROC_NULL || to == own(comm)) return;
    counted[MESSAGES]++;
    counted[MESSAGE_BYTES] += bytes(count, type);
}

static void collect(long long contributed, MPI_Comm comm) {
    if (ranks(comm) < 2) return;
    counted[COLLECTIVES]++;
    counted[COLLECTIVE_BYTES] += contributed;
}

#define SENDING(name, ...) \
    int MPI_##name(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c __VA_ARGS__)
SENDING(Send) { send(n, t, to, c); return PMPI_Send(b, n, t, to, tag, c); }
SENDING(Ssend) { send(n, t, to, c); return PMPI_Ssend(b, n, t, to, tag, c); }
SENDING(Rsend) { send(n, t, to, c); return PMPI_Rsend(b, n, t, to, tag, c); }
SENDING(Bsend) { send(n, t, to, c); return PMPI_Bsend(b, n, t, to, tag, c); }
SENDING(Isend, , MPI_Request *r) { send(n, t, to, c); return PMPI_Isend(b, n, t, to, tag, c, r); }
SENDING(Issend, , MPI_Request *r) { send(n, t, to, c); return PMPI_Issend(b, n, t, to, tag, c, r); }
SENDING(Irsend, , MPI_Request *r) { send(n, t, to, c); return PMPI_Irsend(b, n, t, to, tag, c, r); }

int MPI_Sendrecv(const void *b, int n, MPI_Datatype t, int to, int tag, void *rb, int rn, MPI_Datatype rt, int from,
                 int rtag, MPI_Comm c, MPI_Status *s) {
    send(n, t, to, c);
    return PMPI_Sendrecv(b, n, t, to, tag, rb, rn, rt, from, rtag, c, s);
}

/* Persistent sends by their request: what each sends, once it starts. */
enum { KEPT = 1 << 16 };
static struct { MPI_Request request; long long size; } kept[KEPT];
static int number;

static void keep(MPI_Request request, int count, MPI_Datatype type, int to, MPI_Comm comm) {
    if (to == MPI_PROC_NULL || to == own(comm)) return;
    int k = 0;
    while (k < number && kept[k].request != request && kept[k].request != MPI_REQUEST_NULL) k++;
    if (k == KEPT) MPI_Abort(MPI_COMM_WORLD, 1);
    if (k == number) number++;
    kept[k].request = request;
    kept[k].size = bytes(count, type);
}

static void started(MPI_Request request) {
    for (int k = 0; k < number; k++)
        if (kept[k].request == request) {
            counted[MESSAGES]++;
            counted[MESSAGE_BYTES] += kept[k].size;
            return;
        }
}

#define PREPARING(name) \
    SENDING(name, , MPI_Request *r) { \
        int e = PMPI_##name(b, n, t, to, tag, c, r); \
        keep(*r, n, t, to, c); \
        return e; \
    }
PREPARING(Send_init)
PREPARING(Ssend_init)
PREPARING(Rsend_init)

int MPI_Start(MPI_Request *r) { started(*r); return PMPI_Start(r); }
int MPI_Startall(int n, MPI_Request r[]) {
    for (int k = 0; k < n; k++) started(r[k]);
    return PMPI_Startall(n, r);
}
int MPI_Request_free(MPI_Request *r) {
    for (int k = 0; k < number; k++) if (kept[k].request == *r) kept[k].request = MPI_REQUEST_NULL;
    return PMPI_Request_free(r);
}

static long long others(const int counts[], MPI_Datatype type, MPI_Comm comm) {
    long long sum = 0;
    for (int k = 0; k < ranks(comm); k++) if (k != own(comm)) sum += bytes(counts[k], type);
    return sum;
}

int MPI_Barrier(MPI_Comm c) { collect(0, c); return PMPI_Barrier(c); }
int MPI_Ibarrier(MPI_Comm c, MPI_Request *r) { collect(0, c); return PMPI_Ibarrier(c, r); }
int MPI_Bcast(void *b, int n, MPI_Datatype t, int root, MPI_Comm c) {
    collect(own(c) == root ? bytes(n, t) : 0, c);
    return PMPI_Bcast(b, n, t, root, c);
}
int MPI_Reduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, int root, MPI_Comm c) {
    collect(own(c) == root ? 0 : bytes(n, t), c);
    return PMPI_Reduce(s, r, n, t, o, root, c);
}
int MPI_Allreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collect(bytes(n, t), c);
    return PMPI_Allreduce(s, r, n, t, o, c);
}
int MPI_Iallreduce(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c, MPI_Request *q) {
    collect(bytes(n, t), c);
    return PMPI_Iallreduce(s, r, n, t, o, c, q);
}
int MPI_Scan(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collect(bytes(n, t), c);
    return PMPI_Scan(s, r, n, t, o, c);
}
int MPI_Exscan(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collect(bytes(n, t), c);
    return PMPI_Exscan(s, r, n, t, o, c);
}
int MPI_Reduce_scatter_block(const void *s, void *r, int n, MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collect(bytes(n, t) * (ranks(c) - 1), c);
    return PMPI_Reduce_scatter_block(s, r, n, t, o, c);
}
int MPI_Reduce_scatter(const void *s, void *r, const int n[], MPI_Datatype t, MPI_Op o, MPI_Comm c) {
    collect(others(n, t, c), c);
    return PMPI_Reduce_scatter(s, r, n, t, o, c);
}
int MPI_Gather(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, int root, MPI_Comm c) {
    collect(own(c) == root ? 0 : bytes(n, t), c);
    return PMPI_Gather(s, n, t, r, m, u, root, c);
}
int MPI_Gatherv(const void *s, int n, MPI_Datatype t, void *r, const int m[], const int d[], MPI_Datatype u, int root,
                MPI_Comm c) {
    collect(own(c) == root ? 0 : bytes(n, t), c);
    return PMPI_Gatherv(s, n, t, r, m, d, u, root, c);
}
int MPI_Scatter(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, int root, MPI_Comm c) {
    collect(own(c) == root ? bytes(n, t) * (ranks(c) - 1) : 0, c);
    return PMPI_Scatter(s, n, t, r, m, u, root, c);
}
int MPI_Scatterv(const void *s, const int n[], const int d[], MPI_Datatype t, void *r, int m, MPI_Datatype u, int root,
                 MPI_Comm c) {
    collect(own(c) == root ? others(n, t, c) : 0, c);
    return PMPI_Scatterv(s, n, d, t, r, m, u, root, c);
}
int MPI_Allgather(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, MPI_Comm c) {
    collect(s == MPI_IN_PLACE ? bytes(m, u) : bytes(n, t), c);
    return PMPI_Allgather(s, n, t, r, m, u, c);
}
int MPI_Allgatherv(const void *s, int n, MPI_Datatype t, void *r, const int m[], const int d[], MPI_Datatype u,
                   MPI_Comm c) {
    collect(s == MPI_IN_PLACE ? bytes(m[own(c)], u) : bytes(n, t), c);
    return PMPI_Allgatherv(s, n, t, r, m, d, u, c);
}
int MPI_Alltoall(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, MPI_Comm c) {
    collect((s == MPI_IN_PLACE ? bytes(m, u) : bytes(n, t)) * (ranks(c) - 1), c);
    return PMPI_Alltoall(s, n, t, r, m, u, c);
}
int MPI_Alltoallv(const void *s, const int n[], const int d[], MPI_Datatype t, void *r, const int m[], const int e[],
                  MPI_Datatype u, MPI_Comm c) {
    collect(s == MPI_IN_PLACE ? others(m, u, c) : others(n, t, c), c);
    return PMPI_Alltoallv(s, n, d, t, r, m, e, u, c);
}
int MPI_Alltoallw(const void *s, const int n[], const int d[], const MPI_Datatype t[], void *r, const int m[],
                  const int e[], const MPI_Datatype u[], MPI_Comm c) {
    long long sum = 0;
    for (int k = 0; k < ranks(c); k++)
        if (k != own(c)) sum += s == MPI_IN_PLACE ? bytes(m[k], u[k]) : bytes(n[k], t[k]);
    collect(sum, c);
    return PMPI_Alltoallw(s, n, d, t, r, m, e, u, c);
}
static long long around(const int counts[], MPI_Datatype type, MPI_Comm comm, int in) {
    int from, to, weighted;
    long long sum = 0;
    PMPI_Dist_graph_neighbors_count(comm, &from, &to, &weighted);
    for (int k = 0; k < to; k++) sum += bytes(in ? counts[0] : counts[k], type);
    return sum;
}
int MPI_Neighbor_alltoall(const void *s, int n, MPI_Datatype t, void *r, int m, MPI_Datatype u, MPI_Comm c) {
    collect(around(&n, t, c, 1), c);
    return PMPI_Neighbor_alltoall(s, n, t, r, m, u, c);
}
int MPI_Neighbor_alltoallv(const void *s, const int n[], const int d[], MPI_Datatype t, void *r, const int m[],
                           const int e[], MPI_Datatype u, MPI_Comm c) {
    collect(around(n, t, c, 0), c);
    return PMPI_Neighbor_alltoallv(s, n, d, t, r, m, e, u, c);
}
int MPI_Ineighbor_alltoallv(const void *s, const int n[], const int d[], MPI_Datatype t, void *r, const int m[],
                            const int e[], MPI_Datatype u, MPI_Comm c, MPI_Request *q) {
    collect(around(n, t, c, 0), c);
    return PMPI_Ineighbor_alltoallv(s, n, d, t, r, m, e, u, c, q);
}

/* Of Fortran only that there are none: the factor that each rank holds is alone on its rank. */
#define FORTRAN_CALL(name, comm, parameters, arguments) \
    extern void p##name parameters; \
    void name parameters { \
        if (ranks(MPI_Comm_f2c(*comm)) > 1) counted[FORTRAN]++; \
        p##name arguments; \
    }
FORTRAN_CALL(mpi_send_, c, (void *b, int *n, int *t, int *to, int *tag, int *c, int *e), (b, n, t, to, tag, c, e))
FORTRAN_CALL(mpi_isend_, c, (void *b, int *n, int *t, int *to, int *tag, int *c, int *r, int *e),
             (b, n, t, to, tag, c, r, e))
FORTRAN_CALL(mpi_bcast_, c, (void *b, int *n, int *t, int *root, int *c, int *e), (b, n, t, root, c, e))
FORTRAN_CALL(mpi_allreduce_, c, (void *s, void *r, int *n, int *t, int *o, int *c, int *e), (s, r, n, t, o, c, e))
FORTRAN_CALL(mpi_reduce_, c, (void *s, void *r, int *n, int *t, int *o, int *root, int *c, int *e),
             (s, r, n, t, o, root, c, e))
