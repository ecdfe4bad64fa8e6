//! The tables of a robot file.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

use super::super::schema::{FOOTPRINT, LIDAR, ODOMETRY, ROBOT, SIMULATOR, SONAR, SONARS, Section};
use super::super::suggest;
use super::Reader;

impl Reader<'_> {
    pub(super) fn robot(&mut self, table: &DeTable<'_>) {
        const TABLES: [&Section; 5] = [&FOOTPRINT, &SONARS, &LIDAR, &ODOMETRY, &SIMULATOR];
        for (name, value) in table {
            let path = [name.get_ref().as_ref()];
            if ROBOT.key(path[0]).is_some() {
                self.key(&ROBOT, &path, name.span(), value.get_ref(), &value.span());
            } else if path[0] == SONAR.name {
                self.sonars(&path, value.get_ref(), &value.span());
            } else if let Some(section) = TABLES.iter().find(|section| section.name == path[0]) {
                self.one_table(&path, value, |reader, path, table| reader.section(section, path, table));
                if let DeValue::Table(table) = value.get_ref()
                    && ![ODOMETRY.name, SIMULATOR.name].contains(&section.name)
                {
                    self.complete(section, &path, table, &name.span());
                }
            } else {
                let known: Vec<_> = ["name", "sonar"].into_iter().chain(TABLES.iter().map(|t| t.name)).collect();
                let hint = suggest::key(path[0], &known).unwrap_or_else(|| format!("known are {}", known.join(", ")));
                self.problem(&path, &name.span(), None, format!("unknown key; {hint}"));
            }
        }
        let has = |name: &str| table.iter().any(|(key, _)| key.get_ref() == name);
        for (missing, why) in [
            (!has("name"), "a robot file needs `name = \"…\"`"),
            (!has("sonar") && !has("lidar"), "a robot needs a `[[sonar]]` or a `[lidar]`"),
            (has("sonar") && !has("sonars"), "`[[sonar]]` needs `[sonars]`: what all sonars have in common"),
        ] {
            if missing {
                self.problem(&[], &(0..0), None, why.to_owned());
            }
        }
    }

    fn sonars(&mut self, path: &[&str], value: &DeValue<'_>, span: &Range<usize>) {
        let DeValue::Array(items) = value else {
            return self.problem(path, span, None, "expected one table `[[sonar]]` per sonar".to_owned());
        };
        for (index, item) in items.iter().enumerate() {
            let index = index.to_string();
            let path = [path[0], &index];
            let DeValue::Table(table) = item.get_ref() else {
                self.problem(&path, &item.span(), None, "expected one table `[[sonar]]` per sonar".to_owned());
                continue;
            };
            self.section(&SONAR, &path, table);
            self.complete(&SONAR, &path, table, &item.span());
        }
    }

    /// The keys that a table of a robot file lacks: there are no defaults for a robot's geometry.
    fn complete(&mut self, section: &Section, path: &[&str], table: &DeTable<'_>, span: &Range<usize>) {
        for key in section.keys {
            if !table.iter().any(|(name, _)| name.get_ref() == key.name) {
                let message = format!("missing; expected {} ({})", key.expected, key.about);
                self.problem(&[path, &[key.name]].concat(), span, None, message);
            }
        }
    }
}
