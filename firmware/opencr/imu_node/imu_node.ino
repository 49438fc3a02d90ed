// SPDX-License-Identifier: Apache-2.0
// The node on an OpenCR 1.0: on the motors' line (RS-485 and TTL share one UART), and on USB beside it.
//
// Needs ROBOTIS's Arduino core for the OpenCR, build.sh beside this folder
// puts the portable sources next to this file and builds the image.
#include <Arduino.h>
#include <EEPROM.h>
#include <SPI.h>

#include "chip.h"
#include "node.h"
#include "slave.h"

namespace {

// Whether the board feeds the motors' line from its own 12 V input. False where the line has a supply of its own.
constexpr bool kFeedsLine = true;
constexpr uint32_t kWatchdogMs = 4000;  // longer than the flash takes to erase a page

class OpenCr final : public sinew::Clock, public sinew::Store, public sinew::Spi, public sinew::Board {
public:
    void begin() {
        pinMode(BDPIN_DXL_PWR_EN, OUTPUT);
        digitalWrite(BDPIN_DXL_PWR_EN, kFeedsLine ? HIGH : LOW);
        pinMode(BDPIN_SPI_CS_IMU, OUTPUT);
        digitalWrite(BDPIN_SPI_CS_IMU, HIGH);
        SPI_IMU.begin();
        SPI_IMU.setDataMode(SPI_MODE3);
        SPI_IMU.setBitOrder(MSBFIRST);
        SPI_IMU.setClockDivider(SPI_CLOCK_DIV128);  // registers take 1 MHz at most
    }
    // Readings may be fetched faster than registers are set.
    void speed_up() { SPI_IMU.setClockDivider(SPI_CLOCK_DIV16); }

    uint32_t micros() override { return ::micros(); }
    bool load(uint8_t* bytes, size_t size) override {
        for (size_t at = 0; at < size; ++at) bytes[at] = EEPROM.read(static_cast<int>(at));
        return true;
    }
    void save(const uint8_t* bytes, size_t size) override {
        for (size_t at = 0; at < size; ++at) EEPROM.update(static_cast<int>(at), bytes[at]);
    }
    void exchange(uint8_t* bytes, size_t size) override {
        digitalWrite(BDPIN_SPI_CS_IMU, LOW);
        for (size_t at = 0; at < size; ++at) bytes[at] = SPI_IMU.transfer(bytes[at]);
        digitalWrite(BDPIN_SPI_CS_IMU, HIGH);
    }
    void restart() override { NVIC_SystemReset(); }
    void wait_ms(uint32_t milliseconds) override { delay(milliseconds); }
};

class MotorLine final : public sinew::Wire {
public:
    int read() override { return Serial3.available() > 0 ? Serial3.read() : -1; }
    void write(const uint8_t* bytes, size_t size) override {
        drv_dxl_tx_enable(TRUE);
        Serial3.write(bytes, size);
        Serial3.flush();
        drv_dxl_tx_enable(FALSE);
    }
    void set_baud(uint32_t baud) override {
        Serial3.begin(baud);
        drv_dxl_tx_enable(FALSE);
    }
};

class UsbLine final : public sinew::Wire {
public:
    int read() override { return Serial.available() > 0 ? Serial.read() : -1; }
    void write(const uint8_t* bytes, size_t size) override { Serial.write(bytes, size); }
    void set_baud(uint32_t) override {}  // USB has none
};

OpenCr board;
MotorLine motor_line;
UsbLine usb_line;
sinew::Chip* chip;
sinew::Slave* on_line;
sinew::Slave* on_usb;

}  // namespace

void setup() {
    Serial.begin(1000000);
    board.begin();
    static sinew::Node the_node(board, board);
    static sinew::Chip the_chip(the_node, board, board, board);
    static sinew::Slave motor_slave(the_node, board, motor_line, board);
    static sinew::Slave usb_slave(the_node, board, usb_line, board);
    chip = &the_chip;
    on_line = &motor_slave;
    on_usb = &usb_slave;
    chip->begin();
    board.speed_up();
    wdg_setup(kWatchdogMs);
    wdg_start();
}

void loop() {
    on_line->poll();
    on_usb->poll();
    // Nothing keeps an answer waiting: the chip is read where none is due.
    if (!on_line->is_busy() && !on_usb->is_busy()) chip->poll();
    wdg_refresh();
}
