/* CRC-32 as in zlib: an_crc32("123456789") = 0xCBF43926. */
#ifndef AN_CRC_H
#define AN_CRC_H

#include "an_types.h"

#define AN_CRC_START 0xffffffffu

/* Feed bytes into a shift register initialised to AN_CRC_START; the CRC is its complement. */
uint32_t an_crc_feed(uint32_t crc, const uint8_t *data, uint32_t length);

uint32_t an_crc32(const uint8_t *data, uint32_t length);

#endif
