// SPDX-License-Identifier: Apache-2.0
// The node on an OpenCR 1.0: on the motors' line (RS-485 and TTL share one UART), and on USB beside it.
//
// Needs ROBOTIS's Arduino core for the OpenCR; build.sh puts the portable sources next to this file and builds the image.
#include <Arduino.h>
#include <EEPROM.h>
#include <SPI.h>

// The core's macros of these names break the standard headers below.
#undef abs
#undef max
#undef min

#include "imu_chip.h"
#include "node.h"
#include "slave.h"

// The core's header declares it without C linkage.
extern "C" int32_t CDC_Itf_Write(uint8_t* bytes, uint32_t size);

namespace {

// Whether the board feeds the motors' line from its own 12 V input. Where the line has a supply of its own, two would
// fight; a line without any stays dead, which is seen and harms nothing.
constexpr bool kFeedsLine = false;
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
    // After an error of the line the core restarts its receive buffer from the first place but goes on reading at the
    // old one, so up to 1023 old bytes, whole instructions among them, seem to have come at once. More than the line can
    // have brought since the last look is therefore thrown away.
    int read() override {
        const uint32_t now_us = ::micros();
        const auto waiting = static_cast<uint32_t>(Serial3.available());
        const uint32_t most = left_ + 2 + static_cast<uint32_t>(uint64_t{now_us - looked_us_} * baud_ / kFastestByte);
        looked_us_ = now_us;
        if (waiting > most) Serial3.flushRx(0);
        left_ = waiting > most || waiting == 0 ? 0 : waiting - 1;
        return waiting > most || waiting == 0 ? -1 : Serial3.read();
    }
    // False where the receiver has stopped: the core does not restart it if the error comes while it prepares an answer.
    bool hears() const { return USART3->CR3 & USART_CR3_DMAR && DMA1_Stream1->CR & DMA_SxCR_EN; }
    void write(const uint8_t* bytes, size_t size) override {
        drv_dxl_tx_enable(TRUE);
        Serial3.write(bytes, size);
        Serial3.flush();
        drv_dxl_tx_enable(FALSE);
    }
    void set_baud(uint32_t baud) override {
        Serial3.begin(baud);  // and what had come is thrown away
        drv_dxl_tx_enable(FALSE);
        baud_ = baud;
        left_ = 0;
        looked_us_ = ::micros();
    }

private:
    static constexpr uint32_t kFastestByte = 9 * 1000000;  // bits and microseconds; ten bits, but masters differ

    uint32_t baud_ = 0, left_ = 0, looked_us_ = 0;
};

class UsbLine final : public sinew::Wire {
public:
    int read() override { return Serial.available() > 0 ? Serial.read() : -1; }
    // Serial.write waits 100 ms where nobody reads. An answer without room is not sent instead, and the master asks again.
    void write(const uint8_t* bytes, size_t size) override {
        CDC_Itf_Write(const_cast<uint8_t*>(bytes), static_cast<uint32_t>(size));
    }
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
    if (motor_line.hears()) wdg_refresh();  // a node that does not hear starts anew
}
