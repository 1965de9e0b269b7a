#include "board.h"
#include "registers.h"

enum { SECTOR = 3, WORD = 4, POLLS_MAX = 400000000 };

extern volatile uint8_t table_start[]; /* written by program() */
extern const uint8_t table_bytes[]; /* the linker symbol's address is the size */

const uint8_t *store_table(void)
{
    return (const uint8_t *)(uintptr_t)table_start;
}

uint32_t store_bytes(void)
{
    return (uint32_t)(uintptr_t)table_bytes;
}

static bool done(void)
{
    for (uint32_t i = 0u; i < POLLS_MAX; i++) {
        if ((FLASH->SR & FLASH_SR_BSY) == 0u) {
            return (FLASH->SR & FLASH_SR_ERRORS) == 0u;
        }
    }
    return false;
}

static void unlock(void)
{
    FLASH->KEYR = FLASH_KEY1;
    FLASH->KEYR = FLASH_KEY2;
    FLASH->SR = FLASH_SR_ERRORS;
}

static bool erase(void)
{
    FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_SER | SECTOR << FLASH_CR_SNB_POS;
    FLASH->CR |= FLASH_CR_STRT;
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
    FLASH->CR = FLASH_CR_PSIZE_32 | FLASH_CR_PG;
    for (uint32_t at = 0u; at < length; at += WORD) {
        to[at / WORD] = word_of(data, length, at);
        if (!done()) {
            return false;
        }
    }
    return true;
}

/* The caches may still hold the previous contents of the sector. */
static void flush_caches(void)
{
    const uint32_t caches = FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    const uint32_t forget = FLASH_ACR_ICRST | FLASH_ACR_DCRST;
    FLASH->ACR &= ~caches;
    FLASH->ACR |= forget;
    FLASH->ACR &= ~forget;
    FLASH->ACR |= caches;
}

static bool reads_back(const uint8_t *data, uint32_t length)
{
    for (uint32_t i = 0u; i < length; i++) {
        if (table_start[i] != data[i]) {
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
    FLASH->CR = FLASH_CR_LOCK;
    flush_caches();
    watchdog_start();
    return written && reads_back(data, length);
}
