/* The kernel for any processor: two doubles a register on x86 (SSE2) and Arm (NEON), or plain C (PMR_PLAIN, other
   compilers). */
#if defined __GNUC__ && !defined PMR_PLAIN
#define PMR_VL 2
#if defined __x86_64__
#define PMR_VARIANT "sse2"
#else
#define PMR_VARIANT "vectors"
#endif
#else
#define PMR_VL 1
#define PMR_VARIANT "plain"
#endif
#define PMR_FUNCTIONS pmr_functions_baseline
#include "variant.c"
