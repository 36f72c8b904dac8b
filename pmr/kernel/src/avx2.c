/* The kernel for x86 processors with AVX2 and FMA, in a library that is built for any x86-64. */
#if defined __x86_64__ && defined __GNUC__ && !defined PMR_PLAIN
#include <math.h>
#include <string.h>
#if defined __clang__
#pragma clang attribute push(__attribute__((target("avx2,fma,bmi2"))), apply_to = function)
#else
#pragma GCC target("avx2,fma,bmi2")
#endif
#define PMR_VL 4
#define PMR_VARIANT "avx2"
#define PMR_FUNCTIONS pmr_functions_avx2
#include "variant.c"
#if defined __clang__
#pragma clang attribute pop
#endif
#else
typedef int pmr_nothing; /* C has no empty files */
#endif
