// SPDX-License-Identifier: Apache-2.0
// What imu_node.ino uses of ROBOTIS's core, in outline: enough to find mistakes without it, not to run.
#pragma once

#include <cstddef>
#include <cstdint>

enum { LOW, HIGH, OUTPUT, MSBFIRST, SPI_MODE3, SPI_CLOCK_DIV16, SPI_CLOCK_DIV128, FALSE, TRUE };
enum { BDPIN_DXL_PWR_EN, BDPIN_SPI_CS_IMU };

struct OutlineSerial {
    void begin(uint32_t baud);
    int available();
    int read();
    size_t write(const uint8_t* bytes, size_t size);
    void flush();
};
extern OutlineSerial Serial, Serial3;

struct OutlineSpi {
    void begin();
    void setDataMode(uint8_t mode);
    void setBitOrder(int order);
    void setClockDivider(uint8_t divider);
    uint8_t transfer(uint8_t byte);
};
extern OutlineSpi SPI_IMU;

struct OutlineEeprom {
    uint8_t read(int place);
    void update(int place, uint8_t byte);
};
extern OutlineEeprom EEPROM;

extern "C" {
uint32_t micros();
void delay(uint32_t milliseconds);
void pinMode(int pin, int mode);
void digitalWrite(int pin, int level);
void NVIC_SystemReset();
void drv_dxl_tx_enable(int enable);
int wdg_setup(uint32_t reload_time);
int wdg_start();
int wdg_refresh();
}
