// SPDX-License-Identifier: Apache-2.0
//! A master asked by lines: `dynamixel2-master PORT BAUD` takes instructions on its input, and says what came of each.
//!
//! An instruction is words: its name, then numbers in decimal, then bytes in hexadecimal. The answer is a line: `ok` and bytes
//! in hexadecimal; `refused N`, where the device told error N; `failed` and why. Ids of a group are joined by commas.

use dynamixel2::instructions::{BulkReadData, BulkWriteData, FactoryResetKind, SyncWriteData};
use dynamixel2::{Bus, ReadError, TransferError, WriteError};
use std::io::{BufRead, Write};

type Words<'a> = std::str::SplitWhitespace<'a>;
type Master = Bus<Vec<u8>, Vec<u8>>;

/// The crate waits 34 ms and the time of an answer at the baud that it knows of. A computer that does other work is slower, so
/// it is told of a slow line, on which an answer of no bytes takes 4 s; the port itself has the baud of the line.
const PATIENT_BAUD: u32 = 30;
/// A scan waits for the time of 253 answers: 4 s.
const SCAN_BAUD: u32 = 9_600;

enum Trouble {
    Refused(u8),
    Failed(String),
}

impl From<ReadError> for Trouble {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::MotorError(told) => Trouble::Refused(told.error_number()),
            other => Trouble::Failed(format!("{other:?}")),
        }
    }
}
impl From<WriteError> for Trouble {
    fn from(error: WriteError) -> Self {
        Trouble::Failed(format!("{error:?}"))
    }
}
impl From<TransferError> for Trouble {
    fn from(error: TransferError) -> Self {
        match error {
            TransferError::ReadError(error) => error.into(),
            TransferError::WriteError(error) => error.into(),
        }
    }
}
impl From<std::io::Error> for Trouble {
    fn from(error: std::io::Error) -> Self {
        Trouble::Failed(error.to_string())
    }
}

fn number<T: std::str::FromStr>(words: &mut Words) -> Result<T, Trouble> {
    let word = words.next().unwrap_or("nothing");
    word.parse().map_err(|_| Trouble::Failed(format!("found {word}, expected a number")))
}

fn bytes(words: &mut Words) -> Result<Vec<u8>, Trouble> {
    let word = words.next().unwrap_or("");
    let pairs = word.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap_or(""));
    let read: Result<Vec<u8>, _> = pairs.map(|pair| u8::from_str_radix(pair, 16)).collect();
    read.map_err(|_| Trouble::Failed(format!("found {word}, expected hexadecimal bytes")))
}

fn ids(words: &mut Words) -> Result<Vec<u8>, Trouble> {
    let word = words.next().unwrap_or("");
    let read: Result<Vec<u8>, _> = word.split(',').map(str::parse).collect();
    read.map_err(|_| Trouble::Failed(format!("found {word}, expected ids")))
}

/// Have the crate wait as on a line of a baud, and leave the port's as it is.
fn wait_as_at(bus: &mut Master, waits: u32, line: u32) -> Result<(), Trouble> {
    bus.set_baud_rate(waits)?;
    let mut port = bus.serial_port().try_clone()?;
    let mut settings = port.get_configuration()?;
    settings.set_baud_rate(line)?;
    Ok(port.set_configuration(&settings)?)
}

fn obey(bus: &mut Master, line: u32, words: &mut Words) -> Result<Vec<u8>, Trouble> {
    match words.next().unwrap_or("") {
        "ping" => {
            let told = bus.ping(number(words)?)?.data;
            let [low, high] = told.model.to_le_bytes();
            Ok(vec![low, high, told.firmware])
        }
        "scan" => {
            wait_as_at(bus, SCAN_BAUD, line)?;
            let mut found = Vec::new();
            for answer in bus.scan()? {
                found.push(answer?.motor_id);
            }
            wait_as_at(bus, PATIENT_BAUD, line)?;
            Ok(found)
        }
        "read" => Ok(bus.read(number(words)?, number(words)?, number(words)?)?.data),
        "write" => Ok(bus.write(number(words)?, number(words)?, &bytes(words)?).map(|_| Vec::new())?),
        "reg_write" => Ok(bus.reg_write(number(words)?, number(words)?, &bytes(words)?).map(|_| Vec::new())?),
        "action" => Ok(bus.action(number(words)?).map(|_| Vec::new())?),
        "sync_read" => {
            let (ids, address, count) = (ids(words)?, number(words)?, number(words)?);
            Ok(bus.sync_read(&ids, address, count)?.into_iter().flat_map(|answer| answer.data).collect())
        }
        "bulk_read" => {
            let read = BulkReadData { motor_id: number(words)?, address: number(words)?, count: number(words)? };
            Ok(bus.bulk_read(&[read])?.into_iter().flat_map(|answer| answer.data).collect())
        }
        "sync_write" => {
            let (ids, address, data) = (ids(words)?, number(words)?, bytes(words)?);
            let all: Vec<_> = ids.iter().map(|&motor_id| SyncWriteData { motor_id, data: data.clone() }).collect();
            Ok(bus.sync_write(address, data.len() as u16, &all).map(|()| Vec::new())?)
        }
        "bulk_write" => {
            let write = BulkWriteData { motor_id: number(words)?, address: number(words)?, data: bytes(words)? };
            Ok(bus.bulk_write(&[write]).map(|()| Vec::new())?)
        }
        "reboot" => Ok(bus.reboot(number(words)?).map(|_| Vec::new())?),
        "factory_reset" => Ok(bus.factory_reset(number(words)?, FactoryResetKind::KeepId).map(|_| Vec::new())?),
        other => Err(Trouble::Failed(format!("found {other}, expected an instruction"))),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [path, baud] = words.as_slice() else {
        return Err("usage: dynamixel2-master PORT BAUD".into());
    };
    let line: u32 = baud.parse()?;
    let mut bus = Bus::open(path, line)?;
    if let Err(Trouble::Failed(why)) = wait_as_at(&mut bus, PATIENT_BAUD, line) {
        return Err(why.into());
    }
    for asked in std::io::stdin().lock().lines() {
        let said = match obey(&mut bus, line, &mut asked?.split_whitespace()) {
            Ok(data) => data.iter().fold("ok ".to_string(), |said, byte| format!("{said}{byte:02x}")),
            Err(Trouble::Refused(number)) => format!("refused {number}"),
            Err(Trouble::Failed(why)) => format!("failed {why}"),
        };
        println!("{said}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
