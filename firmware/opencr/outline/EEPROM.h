// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "Arduino.h"

struct EEPROMClass {
    uint8_t read(int place);
    void update(int place, uint8_t byte);
};
extern EEPROMClass EEPROM;
