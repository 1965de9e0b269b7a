#include "board.h"
#include "registers.h"

enum { SECTOR = 3, WORD = 4, PATIENCE = 400000000 };

enum {
    CR_PROGRAM = 1 << 0,
    CR_ERASE = 1 << 1,
    CR_SECTOR = SECTOR << 3,
    CR_WORDS = 2 << 8,
    CR_START = 1 << 16,
    SR_ERRORS = 0xf2,
    SR_BUSY = 1 << 16,
    ACR_CACHES = 3 << 9,
    ACR_FORGET = 3 << 11
};

#define CR_LOCK (1u << 31)

extern const uint8_t table_start[];
extern const uint8_t table_bytes[]; /* its address is the size */

const uint8_t *store_table(void)
{
    return table_start;
}

uint32_t store_bytes(void)
{
    return (uint32_t)(uintptr_t)table_bytes;
}

static bool done(void)
{
    for (uint32_t i = 0u; i < PATIENCE; i++) {
        if ((FLASH->SR & SR_BUSY) == 0u) {
            return (FLASH->SR & SR_ERRORS) == 0u;
        }
    }
    return false;
}

static void unlock(void)
{
    FLASH->KEYR = 0x45670123u;
    FLASH->KEYR = 0xcdef89abu;
    FLASH->SR = SR_ERRORS;
}

static bool erase(void)
{
    FLASH->CR = CR_WORDS | CR_ERASE | CR_SECTOR;
    FLASH->CR |= CR_START;
    return done();
}

static uint32_t word_of(const uint8_t *data, uint32_t length, uint32_t at)
{
    uint32_t word = 0xffffffffu;
    for (uint32_t i = 0u; i < WORD && at + i < length; i++) {
        word &= ~(0xffu << (8u * i)) | (uint32_t)data[at + i] << (8u * i);
    }
    return word;
}

static bool program(const uint8_t *data, uint32_t length)
{
    reg *to = (reg *)(uintptr_t)table_start;
    FLASH->CR = CR_WORDS | CR_PROGRAM;
    for (uint32_t at = 0u; at < length; at += WORD) {
        to[at / WORD] = word_of(data, length, at);
        if (!done()) {
            return false;
        }
    }
    return true;
}

/* The data cache may still hold what stood there before. */
static void forget_caches(void)
{
    FLASH->ACR &= ~(uint32_t)ACR_CACHES;
    FLASH->ACR |= ACR_FORGET;
    FLASH->ACR &= ~(uint32_t)ACR_FORGET;
    FLASH->ACR |= ACR_CACHES;
}

static bool reads_back(const uint8_t *data, uint32_t length)
{
    const volatile uint8_t *stored = table_start;
    for (uint32_t i = 0u; i < length; i++) {
        if (stored[i] != data[i]) {
            return false;
        }
    }
    return true;
}

bool store_write(const uint8_t *data, uint32_t length)
{
    if (length > store_bytes()) {
        return false;
    }
    watchdog_lengthen();
    unlock();
    const bool written = erase() && program(data, length);
    FLASH->CR = CR_LOCK;
    forget_caches();
    watchdog_start();
    return written && reads_back(data, length);
}
