#include "an_crc.h"

/* Remainders of the sixteen half-bytes: a small table, fast enough for a few kilobytes of data. */
static const uint32_t an_crc_nibble[16] = {
    0x00000000u, 0x1db71064u, 0x3b6e20c8u, 0x26d930acu, 0x76dc4190u, 0x6b6b51f4u, 0x4db26158u, 0x5005713cu,
    0xedb88320u, 0xf00f9344u, 0xd6d6a3e8u, 0xcb61b38cu, 0x9b64c2b0u, 0x86d3d2d4u, 0xa00ae278u, 0xbdbdf21cu,
};

uint32_t an_crc_feed(uint32_t crc, const uint8_t *data, uint32_t length)
{
    for (uint32_t i = 0u; i < length; i++) {
        crc ^= data[i];
        crc = (crc >> 4) ^ an_crc_nibble[crc & 15u];
        crc = (crc >> 4) ^ an_crc_nibble[crc & 15u];
    }
    return crc;
}

uint32_t an_crc32(const uint8_t *data, uint32_t length)
{
    return ~an_crc_feed(AN_CRC_START, data, length);
}
