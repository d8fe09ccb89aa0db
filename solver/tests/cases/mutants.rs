//! Folders of LMGC90 with random changes: each is read as the original, or rejected with file and line.
//!
//! Changes of form keep the meaning of the files. Damage takes out, doubles, swaps and shifts lines and letters, where the
//! result cannot be another file that is as good: values and names of contactors and laws are not changed.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cd_formats::compute::ComputeFlags;

use crate::case::uniform;
use crate::forms::folder;

/// Number of changed folders; each variant gets its share.
fn count() -> usize {
    if std::env::var_os("CD_TESTS_LONG").is_some() { 5000 } else { 300 }
}

type Files = BTreeMap<String, String>;

/// Random choices.
struct Dice<F: FnMut() -> f64>(F);

impl<F: FnMut() -> f64> Dice<F> {
    fn below(&mut self, count: usize) -> usize {
        (self.0() * count as f64) as usize % count.max(1)
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }
}

/// Scene and state as text, without notes.
fn reading(case: &Path) -> Result<String, String> {
    let read = cd_solve::read::read_case(case, &ComputeFlags::default());
    let (mut scene, state) = read.map_err(|faults| faults.to_string())?;
    scene.notes.clear();
    scene.warnings.clear();
    Ok(format!("{scene:?} {state:?}"))
}

fn lines(text: &str) -> Vec<String> {
    text.lines().map(String::from).collect()
}

fn joined_lines(lines: Vec<String>) -> String {
    lines.iter().map(|line| format!("{line}\n")).collect()
}

/// Changes a file without changing its meaning; returns a description, `None` if it does not apply.
fn change_form(dice: &mut Dice<impl FnMut() -> f64>, name: &str, text: &str) -> Option<(String, &'static str)> {
    let mut all = lines(text);
    let at = dice.below(all.len() + 1);
    let is_table = name.ends_with(".dat");
    let kind = match dice.below(11) {
        0 => {
            all.insert(
                at,
                dice.one_of(&[" ! a remark", "     # RBDY3 or SPHER", "! coo1= 1.0", "\t! with a tab"]).into(),
            );
            "comment line"
        }
        1 => {
            all.get_mut(at)?.push_str(dice.one_of(&[" ! a remark", "  ! 1.0000000E+00", "   !"]));
            "comment at the end"
        }
        2 => {
            all.insert(at, dice.one_of(&["", "      "]).into());
            "blank line"
        }
        3 => {
            all.get_mut(at)?.push_str("     ");
            "blanks at the end"
        }
        4 if !text.contains('\r') => return Some((text.replace('\n', "\r\n"), "line ends")),
        5 if !is_table && name != "TACT_BEHAV.DAT" && name != "BULK_BEHAV.DAT" => {
            // Outside of records: first, or behind an end of record.
            let ends: Vec<usize> = (0..all.len()).filter(|&k| all[k].starts_with("$$$$$$")).map(|k| k + 1).collect();
            let at = if ends.is_empty() || dice.below(3) == 0 { 0 } else { dice.one_of(&ends) };
            all.insert(at, dice.one_of(&["$$$$$$", "two bodies, version 1.2", "-----------"]).into());
            "line outside of records"
        }
        6 if !is_table => {
            let ends: Vec<usize> = (0..all.len()).filter(|&k| all[k].starts_with("$$$$$$")).collect();
            let at = *ends.get(dice.below(ends.len()))?;
            all[at].push_str(dice.one_of(&["$$$$", "  end of a body", " ! end"]));
            "text behind an end of record"
        }
        7 if name == "BODIES.DAT" => {
            let bodies: Vec<usize> = (0..all.len()).filter(|&k| all[k].starts_with(" RBDY3")).collect();
            let at = dice.one_of(&bodies);
            all[at] = format!(" RBDY3  {}", dice.one_of(&["    1", "    7", "99999", "*****"]));
            "number of a body"
        }
        8 if name == "DOF.INI" || name == "Vloc_Rloc.INI" => {
            let head = all.iter().position(|line| line.starts_with("$steps"))?;
            let shift = dice.one_of(&[-3, -2, -1, 1, 2, 3]);
            let (before, time) = all[head].split_once("time=")?;
            all[head] = format!("{:1$}time={time}", before.trim_end(), (before.len() as i32 + shift) as usize);
            "time in other columns"
        }
        9 if name == "TACT_BEHAV.DAT" => {
            let more = [
                "$behav\n law99  IQS_BW_CLB                      cn  = 1.0000000E+08  ct  = 1.0000000E+06\n",
                "$behav\n law98  SOME_LAW\n                                        par1= 1.0000000E+08\n",
                "$seety\n cdbdy\n RBDY3  DNLYC  NOBDY  iqsc0  RBDY3  POLYR  NOBDY       1.0000000E-02\n",
                "$seety\n cdbdy\n MAILx  CSpxx  BLUEx  iqsc0  RBDY3  PLANx  FLOOR       1.0000000E-02\n",
            ];
            all.extend(lines(dice.one_of(&more)));
            "laws and rows without use"
        }
        10 if name == "BODIES.DAT" => {
            return Some((text.replace("coo1=", "xxxx=").replace("byrd=", "radi "), "labels"));
        }
        _ => return None,
    };
    Some((joined_lines(all), kind))
}

/// Whether a line is complete in itself, so that a file without it, or with it twice, is as good.
fn is_complete(line: &str) -> bool {
    let word = line.get(1..6).unwrap_or("");
    line.trim().is_empty() || ["vlocy", "force", "SPHER", "PT3Dx", "PLANx"].contains(&word)
}

/// Whether lines are of one kind, whose order has a meaning.
fn are_alike(a: &str, b: &str) -> bool {
    let label = |line: &str| line.get(29..33).unwrap_or("").to_string();
    a.get(1..6) == b.get(1..6) && label(a) == label(b) || is_complete(a) && is_complete(b)
}

/// Damages a file; returns a description, `None` if it does not apply.
fn damage(dice: &mut Dice<impl FnMut() -> f64>, name: &str, text: &str) -> Option<(String, &'static str)> {
    let mut all = lines(text);
    let at = dice.below(all.len());
    let is_table = name.ends_with(".dat");
    let letters: Vec<char> = " !$#ABCxyz0123456789.-*".chars().collect();
    let kind = match dice.below(7) {
        0 if !is_complete(&all[at]) => {
            all.remove(at);
            "line taken out"
        }
        1 if !is_complete(&all[at]) => {
            all.insert(at, all[at].clone());
            "line doubled"
        }
        2 if at + 1 < all.len() && !are_alike(&all[at], &all[at + 1]) => {
            all.swap(at, at + 1);
            "lines swapped"
        }
        3 => {
            all[at].insert_str(0, dice.one_of(&[" ", "  ", "   "]));
            "line shifted right"
        }
        4 => {
            let first = dice.below(3) + 1;
            all[at] = all[at].get(first..).unwrap_or("").to_string();
            "line shifted left"
        }
        5 if !is_table && all[at].len() > 8 => {
            // Columns 7 and 8 have no values.
            let column = dice.below(8);
            let letter = dice.one_of(&letters);
            match dice.below(3) {
                0 => all[at].replace_range(column..=column, &letter.to_string()),
                1 => all[at].insert(column, letter),
                _ => drop(all[at].remove(column)),
            }
            // A line that becomes a comment is taken out on purpose, and reported.
            if all[at].trim_start().starts_with(['!', '#']) {
                return None;
            }
            "letter"
        }
        6 if !is_table => {
            // Within the last record, before its last line.
            let heads = ["$bdyty", "$seety", "$icdan"];
            let begin = (0..all.len()).rev().find(|&k| heads.iter().any(|head| all[k].starts_with(head)))?;
            let end = (0..all.len()).rev().find(|&k| !all[k].trim().is_empty() && !all[k].starts_with('!'))?;
            if end < begin + 2 {
                return None;
            }
            let cut = begin + dice.below(end - begin);
            let column = 1 + dice.below(all[cut].len().max(2) - 1);
            all.truncate(cut + 1);
            all[cut].truncate(column);
            return Some((all.join("\n"), "cut short"));
        }
        _ => return None,
    };
    Some((joined_lines(all), kind))
}

#[test]
fn changed_folders_are_read_as_before_or_rejected() {
    let variants = ["base", "state", "point", "patches", "not-convex", "wire-without-row"];
    let mut tally: BTreeMap<String, [usize; 2]> = BTreeMap::new();
    for (seed, variant) in (1..).zip(variants) {
        let case = folder(variant);
        let datbox = case.path().join("DATBOX");
        let original: Files = fs::read_dir(&datbox)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .map(|path| (path.file_name().unwrap().to_str().unwrap().into(), fs::read_to_string(&path).unwrap()))
            .collect();
        let expected = reading(case.path()).unwrap();
        let names: Vec<&String> = original.keys().collect();
        let mut dice = Dice(uniform(seed));
        let mut made = 0;
        while made < count() / variants.len() {
            let mut files = original.clone();
            let mut done = Vec::new();
            // One, two or three changes; the last may be damage.
            let changes = 1 + dice.below(3);
            for k in 0..changes {
                let name = dice.one_of(&names);
                let is_damage = k + 1 == changes && dice.below(2) == 0;
                let changed = match is_damage {
                    true => damage(&mut dice, name, &files[name]),
                    false => change_form(&mut dice, name, &files[name]),
                };
                let Some((text, kind)) = changed else { continue };
                files.insert(name.clone(), text);
                done.push((name.as_str(), kind, is_damage));
            }
            if done.is_empty() {
                continue;
            }
            made += 1;
            files.iter().for_each(|(name, text)| fs::write(datbox.join(name), text).unwrap());
            let found = reading(case.path());
            let shown = || {
                let changed = files.iter().filter(|(name, text)| original[*name] != **text);
                changed.map(|(name, text)| format!("--- {name}\n{text}\n")).collect::<String>()
            };
            match &found {
                Ok(read) => assert!(*read == expected, "{variant} {done:?} is read as something else:\n{}", shown()),
                Err(faults) => {
                    let has_place = |line: &str| names.iter().any(|name| line.contains(&format!("DATBOX/{name}:")));
                    assert!(faults.lines().all(has_place), "{faults}");
                    assert!(done.iter().any(|(_, _, damage)| *damage), "{variant} {done:?}:\n{faults}\n{}", shown());
                }
            }
            let (_, kind, _) = done[done.len() - 1];
            tally.entry(kind.into()).or_default()[usize::from(found.is_err())] += 1;
        }
    }
    println!("read, rejected: {tally:?}");
    let sum = |k: usize| tally.values().map(|both| both[k]).sum::<usize>();
    // Both occur, with each kind of damage.
    assert!(sum(0) > count() / 3 && sum(1) > count() / 10, "{tally:?}");
}
