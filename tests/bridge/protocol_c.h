/* A device's side of the protocol, compiled as freestanding C. */
#ifndef TWINRATE_TESTS_PROTOCOL_C_H
#define TWINRATE_TESTS_PROTOCOL_C_H
#include <stddef.h>
#include <stdint.h>
#ifdef __cplusplus
extern "C" {
#endif
size_t device_sample(unsigned seq, unsigned time_us, float i_a, uint8_t* wire);
/* Of the last command among the bytes; 0 without one. */
float device_u_alpha(const uint8_t* wire, size_t size);
#ifdef __cplusplus
}
#endif
#endif
