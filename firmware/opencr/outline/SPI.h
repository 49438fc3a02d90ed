// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "Arduino.h"

#define SPI_CLOCK_DIV16 0x01
#define SPI_CLOCK_DIV128 0x03
#define SPI_MODE3 3

class SPIClass {
public:
    void begin();
    void setDataMode(uint8_t mode);
    void setBitOrder(uint8_t order);
    void setClockDivider(uint8_t divider);
    uint8_t transfer(uint8_t byte) const;
};
extern SPIClass SPI_IMU;
