// hypot as every glibc of x86-64 has it. That of 2.35 differs in how it reports errors, and a wheel would not load on
// systems before it.
#pragma once
#include <cmath>

#if defined(__x86_64__) && defined(__GLIBC__)
__asm__(".symver hypot, hypot@GLIBC_2.2.5");
#endif
